"""The report on a fit: summary, figures and tables for the terminal, and a self-contained HTML page."""

import dataclasses
import functools
import inspect
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from jaxtyping import Array, Float
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

import famjax
from famjax.boundary.files import Origin, as_html, as_png, as_svg, write_all
from famjax.boundary.units import Quantity, factor, from_si, sentence_in_units, unit_system
from famjax.compile_options import as_arrays, quick_jit

from .arguments import check_path
from .choice import Choice, choice_table
from .covariance import CONDITION_LIMIT
from .data import ForceData
from .evidence import Evidence, Table, evidence_tables, evidence_warnings
from .pictured import PictureFit
from .prediction import static_rows
from .result import Estimate, Identification, check_identified
from .saved import as_json, correlations, fit_as_dict, versions
from .specimen import SPECIMEN_LENGTHS
from .validation import columns_of
from .verdict import Judgement, judge

_SVG_ID = re.compile(r'(\bid="|href="#|url\(#)')


@dataclasses.dataclass(frozen=True)
class PageTable:
    """A table on a page.

    Attributes:
        title: caption, including units that are not in the header.
        header: column headings.
        rows: cells as text.
        groups: headings that span columns, each with the number of columns; "" for no heading.
        text: True if the cells are words, not numbers.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    groups: Sequence[tuple[str, int]] = ()
    text: bool = False

    def html(self, number: int) -> Markup:
        """Render the table as HTML; a table wider than the page scrolls horizontally."""
        return Markup(page("table.html", table=self, number=number))


def page(template: str, package: str = "fitting", **values: object) -> str:
    """Render a template, which usually extends `page.html`.

    Args:
        template: name of a file in the `templates` folder of the package.
        package: package that contains the template.
        values: variables of the template; text is escaped, `markupsafe.Markup` is not.
    """
    return _templates(package).get_template(template).render(**values)


def inline_svg(file: str, name: str, description: str) -> Markup:
    """Return an SVG image for embedding in a page.

    Args:
        file: text of the SVG file.
        name: prefix that makes the ids in the image unique on the page.
        description: alternative text.
    """
    drawn = _SVG_ID.sub(rf"\g<1>{name}-", file[file.index("<svg") :])
    label = f'<svg role="img" aria-label="{escape(description)}"'
    return Markup(drawn.replace("<svg", label, 1))


@functools.cache
def _templates(package: str) -> jinja2.Environment:
    loaders = [jinja2.PackageLoader(name) for name in dict.fromkeys((package, "fitting"))]
    return jinja2.Environment(autoescape=True, loader=jinja2.ChoiceLoader(loaders))


# --- figures

_BEYOND = 1.25  # largest strain of the plotted law, relative to the strain range
_CURVES = 24  # largest number of model curves
_PROFILES = 6  # largest number of profiles in a figure
_SINGLE = 500  # largest number of readings drawn as vectors; more are rasterised


def plot_fit(result: Identification, system: str = "metric") -> Figure:
    """Plot the isobars, the residuals and the bladder law of an identification.

    Args:
        result: fit from `identify`.
        system: "si", "metric" or "us".

    Returns:
        The figure, which is not displayed; save it with `savefig`.
    """
    check_identified(result)
    figure, units, errors = Figure(figsize=(11, 6.2)), unit_system(system), result.errors
    # Fixed positions: a layout engine would draw the figure twice.
    axes = figure.subplot_mosaic(
        [["isobars", "residuals"], ["isobars", "law"]],
        width_ratios=[3.8, 2],
        gridspec_kw={
            "left": 0.065, "right": 0.985, "bottom": 0.085, "top": 0.89, "wspace": 0.2, "hspace": 0.36,
        },
    )  # fmt: skip
    plot_isobars(result, axes["isobars"], system)
    points = _plot_residuals(result, axes["residuals"], system)
    plot_law(result, axes["law"], system)
    label = f"gauge pressure, {units['pressure']}"
    figure.colorbar(points, ax=axes["isobars"], pad=0.02, aspect=35, label=label)
    rmse = Quantity(errors.rmse, "force", 3).in_units(system)
    figure.suptitle(
        f"{result.data.specimen.name}: {result.law.name} law, RMSE {rmse} "
        f"({errors.rmse_percent:.2g} % of the largest force)",
        fontsize=11,
    )
    return figure


def _scatter(
    result: Identification, axes: Axes, values: np.ndarray, system: str, **style: Any
) -> PathCollection:
    """Plot values of the loaded readings against contraction, coloured by pressure."""
    data, loaded = result.data, result.data.loaded
    return axes.scatter(
        1 - data.length[loaded] / data.specimen.rest_length,
        values / _unit(system, "force"),
        c=data.pressure[loaded] / _unit(system, "pressure"),
        rasterized=data.force.size > _SINGLE,
        **style,
    )


def _unit(system: str, kind: str) -> float:
    return factor(unit_system(system)[kind], kind)


def _levels(data: ForceData) -> Float[np.ndarray, " levels"]:
    """Return the pressures [Pa] at which the model is plotted."""
    levels = np.unique(data.pressures.level[data.loaded])
    return levels[:: math.ceil(levels.size / _CURVES)]


def plot_isobars(result: Identification, axes: Axes | None = None, system: str = "metric") -> Axes:
    """Plot measured and modelled force against contraction, coloured by pressure.

    Args:
        result: fit from `identify`.
        axes: axes to plot on; default: pyplot's current axes.
        system: "si", "metric" or "us".

    Returns:
        The axes.
    """
    check_identified(result)
    if axes is None:
        from matplotlib import pyplot  # noqa: PLC0415 -- pyplot may open a display

        axes = pyplot.gca()
    data, rest = result.data, result.data.specimen.rest_length
    style = {"edgecolors": "black", "linewidths": 0.4, "zorder": 3, "label": "measured"}
    points = _scatter(result, axes, data.force[data.loaded], system, s=20, **style)
    lengths, levels = np.linspace(data.length.min(), data.length.max(), 200), _levels(data)
    for level, force in zip(levels, result.predict(lengths, levels[:, None]), strict=True):
        pull = np.where(force < 0, np.nan, force) / _unit(system, "force")
        colour = points.to_rgba(level / _unit(system, "pressure"))
        axes.plot(1 - lengths / rest, pull, color=colour, lw=1)
    axes.lines[-1].set_label("model")
    if data.slack.any():
        slack = 1 - data.length[data.slack] / rest
        style = {"color": "0.6", "ms": 4, "clip_on": False, "label": "slack (not fitted)"}
        axes.plot(slack, np.zeros(slack.size), "x", **style)
    axes.set(xlabel="contraction", ylabel=f"force, {unit_system(system)['force']}", ylim=(0, None))
    axes.legend(frameon=False)
    return axes


def _plot_residuals(result: Identification, axes: Axes, system: str) -> PathCollection:
    """Plot residuals against contraction, coloured by pressure."""
    rmse = result.errors.rmse / _unit(system, "force")
    for level, style in ((0.0, "-"), (rmse, ":"), (-rmse, ":")):
        axes.axhline(level, color="0.7", lw=0.8, ls=style)
    axes.set(xlabel="contraction", ylabel=f"model - measured, {unit_system(system)['force']}")
    axes.set_title("residuals; dotted: +- RMSE", fontsize=9)
    return _scatter(result, axes, result.residuals, system, s=14)


def plot_law(result: Identification, axes: Axes, system: str) -> None:
    """Plot bladder stress against strain."""
    levels = np.zeros(1)
    if result.law.material.depends_on_pressure:
        levels = _levels(result.data)[[0, -1]]
    strain, material = np.linspace(0, _BEYOND * result.strain_range, 400), result.muscle.material
    stresses = np.asarray(quick_jit(law_stress)(as_arrays(material), strain, levels[:, None]))
    for level, stress in zip(levels, stresses / _unit(system, "stress"), strict=True):
        at = f" at {Quantity(level, 'pressure').in_units(system)}" * (levels.size > 1)
        axes.plot(strain, stress, label=f"{result.law.name} law{at}")
    axes.axvspan(0, result.strain_range, color="#dfeaf2", zorder=0, label="strain range used")
    stress = f"true stress, {unit_system(system)['stress']}"
    axes.set(xlabel="engineering strain", ylabel=stress, xlim=(0, strain[-1]))
    axes.set_title("uniaxial " * hasattr(material, "uniaxial_stress") + "bladder law", fontsize=9)
    axes.legend(framealpha=1, fontsize=8)


def plot_profiles(pictures: PictureFit, system: str = "metric") -> Figure:
    """Plot photographed profiles (points) and computed ones (lines), from longest to shortest muscle."""
    figure = Figure(figsize=(11, 3.4), layout="constrained")
    axes, size, unit = figure.subplots(), _unit(system, "length"), unit_system(system)["length"]
    order = np.argsort(-pictures.length)
    for place in order[np.unique(np.linspace(0, order.size - 1, _PROFILES).astype(int))]:
        length = Quantity(float(pictures.length[place]), "length")
        level = Quantity(float(pictures.pressure[place]), "pressure", 3)
        z = pictures.position * length.value / size
        label = f"{length.in_units(system)}, {level.in_units(system)}"
        (line,) = axes.plot(z, pictures.computed[place] / size)
        axes.plot(z, pictures.measured[place] / size, "o", color=line.get_color(), label=label)
    axes.set(xlabel=f"position along the muscle, {unit}", ylabel=f"braid diameter, {unit}")
    axes.legend(title="length, pressure", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def law_stress(
    material: famjax.materials.AbstractMaterial, strain: famjax.Real, pressure: famjax.Real
) -> Float[Array, "pressures strains"]:
    """Return the stress [Pa] in a tensile test, or along one axis if the law does not couple the axes."""
    tensile = getattr(material, "uniaxial_stress", None)
    if tensile is not None:
        return tensile(strain)[None]
    return material.stresses(strain, strain, pressure)[0] + 0 * pressure


# --- text

_ALONE = 0.98
"""Correlation above which the data do not determine two parameters separately."""
_TAKES_PART = {
    "deadband_pressure": "a deadband", "end_factor": "rounded ends", "end_length": "rounded ends",
    "braid_compliance": "a compliant braid", "series_compliance": "a compliant rig",
    "rest_length": "a fitted rest length",
}  # fmt: skip


def described(part: object) -> str:
    """Return the docstring of a part's class up to the attributes; without a docstring, the class name."""
    name, text = type(part).__name__, inspect.cleandoc(type(part).__doc__ or "")
    found = re.split("Attributes:|>>>", text)[0]
    generated = found.startswith(f"{name}(")  # the default docstring of a dataclass
    return " ".join(found.split()) if found and not generated else f"{name}."


def in_words(result: Identification) -> str:
    """Describe the model of a fit in one line: law, geometry and additional effects."""
    muscle = result.muscle
    if not isinstance(muscle, famjax.Muscle):
        return f"{result.law.name} law, with the shape computed from mechanics between two end-fittings"
    order = f" of order {result.law.order}" if result.law.name == "polynomial" else ""
    shape = "a cylindrical braid"
    if type(muscle.geometry).__module__ != "famjax.geometries":
        shape = described(muscle.geometry).partition(":")[0].rstrip(".").lower()
    parts = [
        _TAKES_PART[one.name] for one in result.estimates
        if one.name in _TAKES_PART and one.value > (one.name == "end_factor")  # 1: no effect
    ]  # fmt: skip
    own = (one for one in muscle.terms.terms if type(one).__module__ != "famjax.terms")
    parts += [type(one).__name__ for one in own]
    return f"{result.law.name} law{order}, {shape}{' with ' * bool(parts)}{', '.join(parts)}"


def rounded(value: float, error: float, unit: str, kind: str) -> tuple[str, str]:
    """Format a value and its standard error, both in SI, so that the error has two digits.

    If the error is unknown or zero, it is returned as "" and the value has five digits.

    >>> rounded(4639.8, 64.2, "N", "force"), rounded(0.027335, 8.7e-5, "mm", "length")
    (('4640', '64'), ('27.335', '0.087'))
    """
    value, error = (from_si(float(one), unit, kind) for one in (value, error))
    if not (math.isfinite(error) and error > 0):
        return f"{value:.5g}", ""
    places = 1 - math.floor(math.log10(error))
    shown, spread = (f"{round(one, places):.{max(places, 0)}f}" for one in (value, error))
    return shown, spread


def _parameter(one: Estimate, system: str) -> tuple[str, str, str]:
    """Format a parameter: its value, unit, and standard error or the reason why it has none."""
    unit = unit_system(system)[one.kind]
    value, error = rounded(one.value, one.stderr, unit, one.kind)
    flag = "held" if one.fixed else "at bound" if one.at_bound else error or "none"
    return value, unit, flag


def parameter_table(result: Identification, system: str) -> Table:
    """Return a table of the parameters with standard errors and bounds."""
    rows = []
    for one in result.estimates + result.derived:
        value, unit, error = _parameter(one, system)
        low, high = (from_si(end, unit, one.kind) for end in (one.min, one.max))
        known = math.isfinite(low) and one not in result.derived
        rows.append((one.name, value, unit, error, f"{low:.5g} to {high:.5g}" if known else ""))
    return "Parameters", ("parameter", "value", "unit", "std. error", "bounds"), rows


@dataclasses.dataclass(frozen=True)
class Findings:
    """A fit with its evidence, choice and verdict, formatted as text in a unit system.

    Attributes:
        result: fit from `identify`, or the chosen fit of a choice.
        evidence: validation and uncertainty.
        choice: the `Choice` that produced the result, if any.
        judgement: the verdict; None to derive it from the fit.
    """

    result: Identification
    evidence: Evidence = dataclasses.field(default_factory=Evidence)
    choice: Choice | None = None
    judgement: Judgement | None = None

    @functools.cached_property
    def judged(self) -> Judgement:
        """The verdict."""
        if self.judgement is not None:
            return self.judgement
        question = "" if self.choice is None else self.choice.open_question
        return judge(self.result, (), self.evidence.left_out, question)

    def summary(self, system: str = "metric") -> list[tuple[str, str]]:
        """Return the summary lines, each a label and a sentence."""
        result, errors, judged = self.result, self.result.errors, self.judged
        told = [f"{judged.level.capitalize()}.", *judged.reasons[:2]]
        if len(judged.reasons) > 2:
            told.append("The notes list further concerns.")
        told.append(judged.unchecked)
        model = in_words(result)
        if self.choice is not None:
            model += f"; chosen from {len(self.choice.tried)} models by cross-validation"
        if result.deflection > 0:
            give = Quantity(result.deflection, "length", 3).in_units(system)
            model += f"; the rig deflects by {give} at the largest force"

        def force(value: float) -> str:
            return Quantity(value, "force", 3).in_units(system)

        columns = columns_of(self.evidence.left_out)
        held_out = [f"{force(columns[one])} for {one}s" for one in sorted(columns, reverse=True)]
        error = f"{force(errors.rmse)} ({errors.rmse_percent:.3g} % of the largest force) in sample"
        error += "; held out: " * bool(held_out) + ", ".join(held_out)
        values = []
        for one in self.estimates:
            value, unit, flag = _parameter(one, system)
            with_error = f"+- {flag} {unit}" if flag[0].isdigit() else f"{unit} ({flag})"
            values.append(f"{one.name} {value} {with_error}".rstrip().replace("  ", " "))
        return [
            ("verdict", sentence_in_units(" ".join(filter(None, told)), system)),
            ("model", f"{model}."),
            ("RMSE", f"{error}."),
            ("parameters", f"{'; '.join(values)}."),
            ("not separable", self._not_separable()),
        ]

    @property
    def estimates(self) -> list[Estimate]:
        """The parameters; their standard errors include the shared errors, if these were stated."""
        shared = self.evidence.shared
        std = {} if shared is None else shared.std
        return [
            dataclasses.replace(one, stderr=math.hypot(one.stderr, std.get(one.name, 0.0)))
            for one in self.result.estimates
        ]

    @property
    def untested(self) -> str:
        """Options of `famjax assess` for the tests that this fit has not had."""
        tests = self.evidence
        done = [("--validate", tests.validations), ("--profile", tests.profiles)]
        done += [("--bootstrap 200", tests.bootstrap or tests.posterior)]
        return " ".join(option for option, result in done if not result)

    def _not_separable(self) -> str:
        """List the pairs of parameters that the data determine only in combination."""
        if not self.result.certificate.condition <= CONDITION_LIMIT:
            return "some parameters: these data do not determine every parameter separately."
        names, matrix = correlations(self.result)
        size = np.abs(np.tril(matrix, -1))
        told = [f"{names[j]}, {names[i]}" for i, j in np.argwhere(size > _ALONE)]
        stuck = ", ".join(self.result.stopped)
        stuck = f"; not assessed, at a bound: {stuck}" if stuck else ""
        if not told:
            return f"none; all correlations are below {_ALONE:g}{stuck}."
        return f"{'; '.join(told)} (correlations up to {size.max():.3f}){stuck}."

    def numbers(self, system: str) -> Table:
        """Return a table of five key figures of the muscle, with standard errors."""
        result, units, data = self.result, unit_system(system), self.result.data
        rest, level = data.specimen.rest_length, float(data.pressures.level[data.loaded].max())
        lengths = np.linspace(rest, data.length.min(), 200)
        curve, free, slope = result.predict(lengths, np.array(level)), rest, math.nan
        if end := int(np.argmax(curve < 0)):
            slope = (curve[end - 1] - curve[end]) / (lengths[end - 1] - lengths[end])
            free = lengths[end] - curve[end] / slope
        std, error = np.full(2, math.nan), self.choice or self.evidence.error
        if error is not None:
            std = error.half_band(np.array([rest, free]), np.full(2, level)) / 1.96
        # Name, value, standard error, kind of unit.
        rows = [("blocked force", curve[0], std[0], "force")]
        if end:
            rows.append(("free contraction", 1 - free / rest, std[1] / (slope * rest), "number"))
        known = [one for one in self.estimates if not one.fixed]
        rows += [(one.name, one.value, one.stderr, one.kind) for one in known]
        text = [
            (what, *rounded(value, spread, units[kind], kind), units[kind])
            for what, value, spread, kind in rows[:5]
        ]
        at = Quantity(level, "pressure").in_units(system)
        title = f"The muscle in five numbers, with standard errors. Blocked force at {at}"
        title += " and free contraction at that pressure." if end else "."
        return title, ("quantity", "value", "std. error", "unit"), text

    def model(self, system: str) -> list[str]:
        """Describe the model in sentences: readings, law, geometry, terms, stability, optimum."""
        result, certificate, muscle = self.result, self.result.certificate, self.result.muscle
        rig = "compliant, see series_compliance" if float(result.mounted.compliance) else "rigid"
        geometry, told = muscle, []
        if not isinstance(muscle, famjax.Muscle):
            told = [
                "F = dPi/dL, where Pi(L, P) is the minimum of the strain energy minus (P - P_d) V over all "
                "shapes r(Z) between the fittings. The shape is stable at every loaded reading "
                f"(smallest stiffness {certificate.shape_margin / 1e3:.3g} N/mm). The force is not linear "
                "in the law's parameters, so the optimum is the best one found and has no certificate."
            ]
            told += [] if result.pictures is None else [result.pictures.summary()]
        else:
            geometry = muscle.geometry
            # The margin of an active constraint is zero within rounding.
            margin = Quantity(np.round(certificate.stability_margin) + 0.0, "stress", 3)
            terms = [described(one).partition(". ")[0].rstrip(".") for one in muscle.terms.terms]
            told = [
                f"Force terms: {'; '.join(terms)}. Friction is not included.",
                f"The Drucker stability margin on the actuation path is {margin.in_units(system)} (stable "
                "if >= 0). The coefficients are globally optimal for this geometry (KKT residual "
                f"{certificate.kkt_residual:.0e}).",
            ]
        return [
            self._readings(system),
            f"Bladder law: {described(muscle.material)}",
            f"Geometry: {described(geometry)} The rig is {rig}.",
            *told,
            "The fit describes only the quasi-static force within the measured lengths and pressures. "
            "The braid angle is measured from the circumference.",
        ]

    def _readings(self, system: str) -> str:
        """Describe the specimen and the ranges of the readings."""
        data, specimen = self.result.data, self.result.data.specimen

        def said(value: float, kind: str) -> str:
            return Quantity(value, kind, 5).in_units(system)

        known = [(name.replace("_", " "), getattr(specimen, name)) for name in SPECIMEN_LENGTHS]
        ranges = [(kind, getattr(data, kind)) for kind in ("length", "pressure", "force")]
        told = [f"{name} {said(size, 'length')}" for name, size in known if size]
        told += [f"{kind} {said(of.min(), kind)} to {said(of.max(), kind)}" for kind, of in ranges]
        return f"{data.force.size} readings, {data.loaded.sum()} of them loaded: {', '.join(told)}."

    def tables(self, system: str = "metric") -> list[Table]:
        """Return the tables of a fit."""
        return [
            *([] if self.choice is None else [choice_table(self.choice, system)]),
            parameter_table(self.result, system),
            *evidence_tables(self.evidence, self.result, system),
        ]

    def notes(self, system: str = "metric") -> tuple[str, ...]:
        """Return the notes for the summary: choice, further reasons, warnings, bands."""
        choice, error = self.choice, self.evidence.error
        found = (
            *(() if choice is None else (choice.clear, *choice.dropped)),
            *self.judged.reasons[2:],
            *(one for one in self.result.warnings if one not in self.judged.reasons),
            *evidence_warnings(self.evidence, self.result),
            *(() if error is None else (f"The 95 % prediction bands cover {error.covers}.",)),
        )
        return tuple(sentence_in_units(one, system) for one in found)

    def html(self, system: str = "metric") -> str:
        """Return verdict, table and figure as HTML for a notebook."""
        figure = Figure(figsize=(6, 3.6), layout="constrained")
        plot_isobars(self.result, figure.subplots(), system)
        return as_html(self.result.data.specimen.name, self.summary(system), figure)


# --- the page

_GRID = 41, 25
"""Number of slider positions on a page, for length and pressure."""


def live(result: Identification, system: str) -> dict[str, Any]:
    """Evaluate a muscle at every slider position on a page, with numbers formatted as by `famjax predict`.

    Returns:
        A dict with `units` (of length, pressure and force) and `json` (all values, and the outline of the
        muscle).
    """
    units, data, rest = unit_system(system), result.data, result.data.specimen.rest_length
    used = {kind: units[kind] for kind in ("length", "pressure", "force")}

    def shown(values: Iterable[float], kind: str) -> list[str]:
        return [f"{from_si(one, used[kind], kind):.5g}" for one in values]

    levels = _levels(data)
    length = shown(np.linspace(data.length.min(), data.length.max(), _GRID[0]), "length")
    steps = shown(np.linspace(levels[0], levels[-1], _GRID[1]), "pressure")
    pressure = sorted({*steps, *shown(levels, "pressure")}, key=float)
    L, P = np.meshgrid(
        np.array(length, float) * _unit(system, "length"),
        np.array(pressure, float) * _unit(system, "pressure"), indexing="ij",
    )  # fmt: skip
    rows, size = static_rows(result, L.ravel(), P.ravel()), _unit(system, "length")

    def force(key: str) -> list[list[str | None]]:
        text = [None if row[key] is None else shown([row[key]], "force")[0] for row in rows]
        return np.reshape(np.array(text, object), L.shape).tolist()

    def known(values: Any) -> list[list[float]]:
        return [[float(f"{one:.4g}") for one in row] for row in np.asarray(values)]

    radius, angle = _middle(result.muscle, L, P)
    points = [getattr(data, kind)[data.loaded] / _unit(system, kind) for kind in used]
    content = {
        "length": length, "pressure": pressure, "units": used,
        "force": force("force_N"), "low": force("low_95_N"), "high": force("high_95_N"),
        "radius": known(radius / size), "angle": known(angle), "rest": rest / size,
        "rest_radius": float(np.nanmin(radius)) / size,
        "shown": [pressure.index(one) for one in shown(levels, "pressure")],
        "points": np.stack(points, axis=1)[:_SINGLE].round(6).tolist(),
    }  # fmt: skip
    text = json.dumps(as_json(content), allow_nan=False, separators=(",", ":"))
    return {"json": Markup(text), "units": used}


def _middle(
    muscle: "famjax.Muscle | famjax.EquilibriumMuscle", length: np.ndarray, pressure: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the radius [m] and braid angle [rad] halfway between the fittings."""
    if isinstance(muscle, famjax.Muscle):
        at = quick_jit(_dimensions)(as_arrays(muscle.geometry), length, pressure)
        return np.asarray(at[0]), np.asarray(at[1])
    shape = muscle.profile(length, pressure, 3)
    return np.asarray(shape.radius[..., 1]), np.asarray(shape.braid_angle[..., 1])


def _dimensions(geometry: Any, length: Any, pressure: Any) -> tuple[Any, Any]:
    at = geometry.dimensions(length, pressure)
    return at.radius, at.braid_angle


def html_report(
    found: Findings,
    system: str = "metric",
    figure: Figure | None = None,
    origin: Origin | None = None,
) -> str:
    """Return the report as one self-contained HTML page; an existing `figure` from `plot_fit` is reused."""
    result, profiles = found.result, None
    drawn = as_svg(plot_fit(result, system) if figure is None else figure)
    if result.pictures is not None:
        both = as_svg(plot_profiles(result.pictures, system))
        profiles = inline_svg(both, "profiles", "photographed and computed profiles")
    content = [found.numbers(system), *found.tables(system)]
    data, unit = result.data, unit_system(system)
    middle = np.flatnonzero(data.loaded)[data.loaded.sum() // 2]
    length = from_si(float(data.length[middle]), unit["length"], "length")
    pressure = from_si(float(data.pressure[middle]), unit["pressure"], "pressure")
    return page(
        "report.html",
        found=found,
        system=system,
        figure=inline_svg(drawn, "fit", "isobars, residuals and the bladder law"),
        profiles=profiles,
        tables=[PageTable(*table).html(k) for k, table in enumerate(content, start=1)],
        origin=origin,
        versions=versions(),
        state=(f"{length:.4g}{unit['length']}", f"{pressure:.4g}{unit['pressure']}"),
        live=live(result, system),
    )


def write_fit(
    result: Identification,
    folder: Path | str,
    system: str = "metric",
    evidence: Evidence | None = None,
    origin: Origin | None = None,
    *,
    choice: Choice | None = None,
    judgement: Judgement | None = None,
    problem: Mapping[str, Any] | None = None,
) -> list[Path]:
    """Write `fit.json`, `fit.png` and `report.html`: either all of them or none.

    Args:
        result: fit from `identify`.
        folder: output folder, created if missing; files from an earlier fit are replaced.
        system: units of figure and report; `fit.json` is in SI.
        evidence: validation and uncertainty, if available.
        origin: date and command to record in the file and the report.
        choice: the `Choice` that produced the result, if any.
        judgement: the verdict; default: derived from the fit.
        problem: problem description from which `famjax assess` repeats the fit.

    Returns:
        The paths written.

    Raises:
        InputError: the folder cannot be written.
    """
    check_identified(result)
    folder = check_path("folder", folder)
    found = Findings(result, evidence or Evidence(), choice, judgement)
    document = fit_as_dict(result, evidence, origin, choice=choice, judgement=found.judged)
    figure, document = plot_fit(result, system), {**document, "problem": problem}
    files = {
        "fit.json": json.dumps(document, indent=1, allow_nan=False).encode(),
        "fit.png": as_png(figure),
        "report.html": html_report(found, system, figure, origin).encode(),
    }
    return write_all(folder, files)
