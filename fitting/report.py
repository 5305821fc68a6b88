"""The report of a fit: summary, figures and tables for the terminal, and a self-contained HTML page."""

import dataclasses
import functools
import inspect
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
import numpy as np
from jaxtyping import Array, Float
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import famjax
from famjax.boundary.files import Origin, as_html, as_png, as_svg, write_all
from famjax.boundary.units import Quantity, factor, from_si, sentence_in_units, unit_system
from famjax.compile_options import as_arrays, quick_jit

from .arguments import check_path
from .choice import Choice, choice_table
from .evidence import Evidence, Table, evidence_tables, evidence_warnings
from .pictured import PictureFit
from .prediction import static_rows
from .result import Estimate, Identification, check_identified
from .saved import correlations, fit_as_dict, versions
from .validation import columns_of
from .verdict import Judgement, judge

_SVG_ID = re.compile(r'(\bid="|href="#|url\(#)')


@dataclasses.dataclass(frozen=True)
class PageTable:
    """A table of a page.

    Attributes:
        title: caption, with units that the header does not give.
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

    def html(self, number: int | None = None) -> Markup:
        """Render the table as HTML; a table wider than the page scrolls horizontally."""
        label = Markup("") if number is None else Markup(f"<b>Table {number}.</b>")
        return Markup(
            _templates("fitting").get_template("table.html").render(table=self, label=label)
        )


def page(template: str, package: str = "fitting", **values: object) -> str:
    """Render a template that extends `page.html`.

    Args:
        template: name of a file in the folder `templates` of the package.
        package: package that contains the template.
        values: variables of the template; text is escaped, `markupsafe.Markup` is not.
    """
    return _templates(package).get_template(template).render(**values)


def inline_svg(file: str, name: str, description: str) -> Markup:
    """Return an SVG image for embedding in a page.

    Args:
        file: text of the SVG file.
        name: prefix that makes its ids unique on the page.
        description: alternative text.
    """
    drawn = _SVG_ID.sub(rf"\g<1>{name}-", file[file.index("<svg") :])
    label = f'<svg role="img" aria-label="{escape(description)}"'
    return Markup(drawn.replace("<svg", label, 1))


@functools.cache
def _templates(package: str) -> jinja2.Environment:
    loaders = [jinja2.PackageLoader(name) for name in dict.fromkeys((package, "fitting"))]
    return jinja2.Environment(autoescape=True, loader=jinja2.ChoiceLoader(loaders))


_COLOURS = mpl.colormaps["viridis"]
_BEYOND = 1.25  # largest strain of the plotted law, relative to the strain range
_CURVES = 24  # largest number of model curves
_PROFILES = 6  # largest number of profiles in a figure
_SINGLE = 500  # largest number of readings drawn as vectors; more are rasterised


def plot_fit(result: Identification, system: str = "metric") -> Figure:
    """Plot isobars, residuals and material law of an identification.

    Args:
        result: result of `identify`.
        system: "si", "metric" or "us".

    Returns:
        The figure, not shown; save it with `savefig`.
    """
    check_identified(result)
    figure = Figure(figsize=(11, 6.2))
    FigureCanvasAgg(figure)
    # Fixed positions: a layout engine would draw the figure twice.
    axes = figure.subplot_mosaic(
        [["isobars", "bar", ".", "residuals"], ["isobars", "bar", ".", "law"]],
        width_ratios=[3, 0.06, 0.62, 2],
        gridspec_kw={
            "left": 0.065, "right": 0.985, "bottom": 0.085, "top": 0.89, "wspace": 0.04,
            "hspace": 0.36,
        },
    )  # fmt: skip
    plot_isobars(result, axes["isobars"], system)
    plot_residuals(result, axes["residuals"], system)
    plot_law(result, axes["law"], system)
    figure.colorbar(
        ScalarMappable(_shade(result, system), _COLOURS),
        cax=axes["bar"],
        label=f"gauge pressure, {unit_system(system)['pressure']}",
    )
    errors = result.errors

    def force(value: float, digits: int) -> str:
        return Quantity(value, "force", digits).in_units(system)

    figure.suptitle(
        f"{result.data.specimen.name}: RMSE {force(errors.rmse, 3)} ({errors.rmse_percent:.2g} % of "
        f"{force(errors.max_force, 5)}), law: {result.law.name}, constraint: {result.constraint}",
        fontsize=11,
    )
    return figure


def _shade(result: Identification, system: str) -> Normalize:
    """Colour scale of the pressures of a map."""
    levels = result.data.pressures.level / _unit(system, "pressure")
    return Normalize(levels.min(), levels.max())


def _axes(result: Identification, axes: Axes | None) -> Axes:
    """Return the given axes, or pyplot's current ones."""
    check_identified(result)
    if axes is not None:
        return axes
    from matplotlib import pyplot  # noqa: PLC0415 -- pyplot may open a display

    return pyplot.gca()


def _scatter(
    result: Identification, axes: Axes, values: np.ndarray, system: str, **style: Any
) -> None:
    """Plot values of the loaded readings against contraction, coloured by pressure."""
    data, loaded = result.data, result.data.loaded
    axes.scatter(
        1 - data.length[loaded] / data.specimen.rest_length,
        values / _unit(system, "force"),
        c=data.pressure[loaded] / _unit(system, "pressure"),
        norm=_shade(result, system),
        cmap=_COLOURS,
        rasterized=data.force.size > _SINGLE,
        **style,
    )


def _unit(system: str, kind: str) -> float:
    return factor(unit_system(system)[kind], kind)


def plot_isobars(result: Identification, axes: Axes | None = None, system: str = "metric") -> Axes:
    """Plot measured and modelled force against contraction, coloured by pressure.

    Args:
        result: result of `identify`.
        axes: axes to draw on; default: pyplot's current ones.
        system: "si", "metric" or "us".

    Returns:
        The axes.
    """
    axes, shade, data = _axes(result, axes), _shade(result, system), result.data
    force_unit, pressure_unit = _unit(system, "force"), _unit(system, "pressure")
    rest = data.specimen.rest_length
    lengths = np.linspace(data.length.min(), data.length.max(), 200)
    levels = np.unique(data.pressures.level[data.loaded])
    shown = np.linspace(0, levels.size - 1, min(levels.size, _CURVES)).round().astype(int)
    levels = levels[shown]
    for level, force in zip(levels, result.predict(lengths, levels[:, None]), strict=True):
        pull = np.where(force < 0, np.nan, force) / force_unit
        axes.plot(1 - lengths / rest, pull, color=_COLOURS(shade(level / pressure_unit)), lw=1)
    style = {"edgecolors": "black", "linewidths": 0.4, "zorder": 3}
    _scatter(result, axes, data.force[data.loaded], system, s=20, **style)
    axes.plot([], [], "o", mfc="white", mec="black", ms=4.5, label="measured")
    axes.plot([], [], color="0.4", lw=1, label="model")
    if data.slack.any():
        slack = 1 - data.length[data.slack] / rest
        style = {"color": "0.6", "ms": 4, "clip_on": False, "label": "slack (not fitted)"}
        axes.plot(slack, np.zeros(slack.size), "x", **style)
    axes.set(xlabel="contraction", ylabel=f"force, {unit_system(system)['force']}", ylim=(0, None))
    axes.legend(frameon=False)
    return axes


def plot_residuals(
    result: Identification, axes: Axes | None = None, system: str = "metric"
) -> Axes:
    """Plot residuals against contraction, coloured by pressure; arguments as in `plot_isobars`."""
    axes, rmse = _axes(result, axes), result.errors.rmse / _unit(system, "force")
    for level, style in ((0.0, "-"), (rmse, ":"), (-rmse, ":")):
        axes.axhline(level, color="0.7", lw=0.8, ls=style)
    _scatter(result, axes, result.residuals, system, s=14)
    axes.set(xlabel="contraction", ylabel=f"model - measured, {unit_system(system)['force']}")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_title("residuals; dotted: +- RMSE", fontsize=9)
    return axes


def plot_law(result: Identification, axes: Axes | None = None, system: str = "metric") -> Axes:
    """Plot bladder stress against strain, dashed where it decreases; arguments as in `plot_isobars`."""
    axes, nodes = _axes(result, axes), result.node_pressures
    strain, material = np.linspace(0, _BEYOND * result.strain_range, 400), result.muscle.material
    if nodes is None:
        pressures, labels = np.zeros(1), [f"{result.law.name} law"]
    else:
        pressures = nodes[sorted({0, len(nodes) // 2, len(nodes) - 1})]
        labels = [f"at {Quantity(pressure, 'pressure').in_units(system)}" for pressure in pressures]
    stresses = np.asarray(quick_jit(law_stress)(as_arrays(material), strain, pressures[:, None]))
    for label, stress in zip(labels, stresses / _unit(system, "stress"), strict=True):
        falls = np.gradient(stress, strain) < 0
        (line,) = axes.plot(strain, np.where(falls, np.nan, stress), label=label)
        axes.plot(strain, np.where(falls, stress, np.nan), color=line.get_color(), ls="--")
    axes.axvspan(0, result.strain_range, color="#dfeaf2", zorder=0, label="strain range used")
    stress = f"true stress, {unit_system(system)['stress']}"
    axes.set(xlabel="engineering strain", ylabel=stress, xlim=(0, strain[-1]))
    way = "uniaxial " * hasattr(material, "uniaxial_stress")
    axes.set_title(f"{way}bladder law; dashed where falling", fontsize=9)
    axes.legend(framealpha=1, fontsize=8)
    return axes


def plot_profiles(pictures: PictureFit, system: str = "metric") -> Figure:
    """Plot photographed (points) and computed profiles (lines) from the longest to the shortest muscle."""
    figure = Figure(figsize=(11, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes, size = figure.subplots(), _unit(system, "length")
    order = np.argsort(-pictures.length)
    for place in order[np.unique(np.linspace(0, order.size - 1, _PROFILES).astype(int))]:
        length, level = float(pictures.length[place]), float(pictures.pressure[place])
        z = pictures.position * length / size
        (line,) = axes.plot(z, pictures.computed[place] / size)
        told = [Quantity(length, "length", 4), Quantity(level, "pressure", 3)]
        axes.plot(z, pictures.measured[place] / size, "o", color=line.get_color(), markersize=4,
                  label=", ".join(one.in_units(system) for one in told))  # fmt: skip
    unit = unit_system(system)["length"]
    axes.set(xlabel=f"position along the muscle, {unit}", ylabel=f"braid diameter, {unit}")
    axes.legend(title="length, pressure", loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.margins(y=0.1)
    return figure


def law_stress(
    material: famjax.materials.AbstractMaterial, strain: famjax.Real, pressure: famjax.Real
) -> Float[Array, "pressures strains"]:
    """Stress [Pa] in a tensile test, or in one direction if the law has no interaction."""
    tensile = getattr(material, "uniaxial_stress", None)
    if tensile is not None:
        return tensile(strain)[None]
    return material.stresses(strain, strain, pressure)[0] + 0 * pressure


def specimen_table(result: Identification, system: str) -> Table:
    """Return the table of the specimen and the ranges of the readings."""
    data, units = result.data, unit_system(system)

    def row(name: str, value: Any) -> tuple[str, ...]:
        if value is None or isinstance(value, bool | str):
            words: dict[Any, str] = {None: "not given", True: "yes", False: "no"}
            return name, words.get(value, str(value)), ""
        return name, f"{from_si(float(value), units['length'], 'length'):.5g}", units["length"]

    rows = [row(k.replace("_", " "), v) for k, v in dataclasses.asdict(data.specimen).items()]
    for name in ("length", "pressure", "force"):
        ends = (from_si(f(getattr(data, name)), units[name], name) for f in (np.min, np.max))
        rows.append((f"{name}s measured", " to ".join(f"{end:.5g}" for end in ends), units[name]))
    rows.append(("readings", f"{data.force.size}, {data.loaded.sum()} of them pulling", ""))
    return "Specimen and readings", ("entry", "value", "unit"), rows


_ALONE = 0.98
"""Correlation above which the data do not determine two parameters separately."""
_TAKES_PART = {
    "deadband_pressure": "a deadband", "end_factor": "rounded ends", "end_length": "rounded ends",
    "braid_compliance": "a compliant braid", "series_compliance": "a compliant rig",
}  # fmt: skip


def described(part: object) -> str:
    """Return the docstring of a class up to its attributes, or else its name."""
    name, text = type(part).__name__, inspect.cleandoc(type(part).__doc__ or "")
    found = re.split("Attributes:|>>>", text)[0]
    generated = found.startswith(f"{name}(")  # the default docstring of a dataclass
    return " ".join(found.split()) if found and not generated else f"{name}."


def terms_of(muscle: famjax.AbstractMuscle) -> tuple[famjax.terms.AbstractForceTerm, ...]:
    """Return the force terms of a muscle, if it has any."""
    return muscle.terms.terms if isinstance(muscle, famjax.Muscle) else ()


def in_words(result: Identification) -> str:
    """Describe the model of a fit in one line: law, geometry and extras."""
    muscle = result.muscle
    if isinstance(muscle, famjax.EquilibriumMuscle):
        return f"{result.law.name} law, the shape from mechanics between two end-fittings"
    geometry, terms = muscle.geometry, muscle.terms.terms
    order = f" of order {result.order}" if result.law.name == "polynomial" else ""
    shape = "a cylindrical braid"
    if type(geometry).__module__ != "famjax.geometries":
        shape = described(geometry).partition(":")[0].rstrip(".").lower()
    parts = [
        _TAKES_PART[one.name] for one in result.estimates
        if one.name in _TAKES_PART and one.value > (one.name == "end_factor")  # 1: no effect
    ]  # fmt: skip
    parts += [type(one).__name__ for one in terms if type(one).__module__ != "famjax.terms"]
    return f"{result.law.name} law{order}, {shape}{' with ' * bool(parts)}{', '.join(parts)}"


_WITHIN = (
    "The fit describes the quasi-static force within the measured lengths and pressures only. "
    "The braid angle is measured from the circumference."
)


@dataclasses.dataclass(frozen=True)
class Findings:
    """A fit with its evidence, choice and verdict, formatted as text in a unit system.

    Attributes:
        result: result of `identify`, or the chosen fit of a choice.
        evidence: validation and uncertainty.
        choice: choice that the result comes from, if any.
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

    def verdict(self, system: str, most: int | None = None) -> str:
        """Return the verdict with its most serious reasons, and what could not be checked."""
        told = [f"{self.judged.level.capitalize()}.", *self.judged.reasons[:most]]
        return " ".join(
            sentence_in_units(one, system) for one in (*told, self.judged.unchecked) if one
        )

    def summary(self, system: str = "metric") -> list[tuple[str, str]]:
        """Return the summary lines, each a label and a sentence."""
        result, errors = self.result, self.result.errors
        model = in_words(result)
        if self.choice is not None:
            model += f"; chosen from {len(self.choice.tried)} by cross-validation"

        def force(value: float) -> str:
            return Quantity(value, "force", 3).in_units(system)

        columns = columns_of(self.evidence.left_out)
        held_out = [f"{force(columns[one])} on {one}s" for one in sorted(columns, reverse=True)]
        error = f"{force(errors.rmse)} ({errors.rmse_percent:.3g} % of the largest force) in sample"
        error += "; held out: " * bool(held_out) + ", ".join(held_out)
        values = [_with_error(one, system) for one in result.all_estimates]
        return [
            ("verdict", self.verdict(system, 2)),
            ("model", f"{model}."),
            ("RMSE", f"{error}."),
            ("parameters", f"{'; '.join(values)}."),
            ("not separable", self._not_separable()),
        ]

    def _not_separable(self) -> str:
        """Name the groups of parameters that the data determine only together."""
        if not np.isfinite(self.result.certificate.condition):
            return "the parameters: these data do not determine each of them."
        names, matrix = correlations(self.result)
        size, groups = np.abs(np.tril(matrix, -1)), []
        for pair in np.argwhere(size > _ALONE).tolist():
            own = [group for group in groups if group & {*pair}]
            groups = [group for group in groups if group not in own] + [{*pair}.union(*own)]
        told = [", ".join(names[k] for k in sorted(group)) for group in groups]
        if not told:
            return f"none; all correlations are below {_ALONE:g}."
        return f"{'; '.join(told)} (correlations up to {size.max():.3f})."

    def numbers(self, system: str) -> Table:
        """Return the table of the five main numbers of a muscle, with standard errors."""
        result, units = self.result, unit_system(system)
        data, rest = result.data, result.data.specimen.rest_length
        levels = np.unique(data.pressures.level[data.loaded])
        lengths = np.linspace(rest, data.length.min(), 200)
        curves = result.predict(lengths, levels[:, None])

        # Name, pressure, value, standard error, kind of unit.
        rows: list[tuple[str, float, float, float, str]] = [
            ("blocked force", levels[-1], curves[-1, 0], self._std(rest, levels[-1]), "force")
        ]
        ended = [k for k, curve in enumerate(curves) if curve[0] > 0 > curve[-1]]
        for level, curve in [(levels[k], curves[k]) for k in ended[-1:]]:
            end = int(np.argmax(curve < 0))
            slope = (curve[end - 1] - curve[end]) / (lengths[end - 1] - lengths[end])
            length = lengths[end] - curve[end] / slope
            std = self._std(length, level) / (slope * rest)
            rows.append(("free contraction", level, 1 - length / rest, std, "number"))
        held_out = columns_of(self.evidence.left_out)
        rows += [
            ("RMSE, left out", math.nan, value, math.nan, "force")
            for name, value in sorted(held_out.items()) if name != "end length"
        ][:1]  # fmt: skip
        known = [one for one in result.estimates if not one.fixed]
        elastic = [one for one in known if one.kind == "stress"]
        known = list(dict.fromkeys((*known[:1], *elastic[:1], *known)))
        rows += [(one.name, math.nan, one.value, one.stderr, one.kind) for one in known]

        def shown(value: float, kind: str, digits: int) -> str:
            scaled = from_si(float(value), units[kind], kind)
            return f"{scaled:.{digits}g}" if math.isfinite(scaled) else ""

        text = [
            (what, shown(level, "pressure", 3), shown(value, kind, 5), shown(error, kind, 2),
             units[kind])
            for what, level, value, error, kind in rows[:5]
        ]  # fmt: skip
        title = (
            f"The muscle in five numbers, with standard errors; pressures in {units['pressure']}."
        )
        return title, ("quantity", "pressure", "value", "std. error", "unit"), text

    def _std(self, length: float, pressure: float) -> float:
        """Standard error [N] of a predicted reading; nan if unknown."""
        known = self.choice or self.evidence.error
        if known is None:
            return math.nan
        return float(known.half_band(np.array([length]), np.array([pressure]))[0]) / 1.96

    def next_steps(self, system: str) -> list[str]:
        """Return the recommended next steps: remedies for each doubt, then commands."""
        doubts = (*self.judged.reasons, self.judged.unchecked)
        asked = [sentence_in_units(one, system) for one in doubts if one]
        if not self.judged.passed:
            return asked
        data, units = self.result.data, unit_system(system)
        L, P = (float(np.median(v[data.loaded])) for v in (data.length, data.pressure))
        length, pressure = (
            f"{from_si(v, units[kind], kind):.4g}{units[kind]}"
            for v, kind in ((L, "length"), (P, "pressure"))
        )
        return [
            *asked,
            f"Predict: famjax predict fit.json --length {length} --pressure {pressure}",
            "Test further: famjax assess fit.json --validate --profile",
        ]

    def model(self, system: str) -> list[str]:
        """Describe the model in sentences: law, geometry, terms, stability, optimum."""
        result, certificate = self.result, self.result.certificate
        muscle = result.muscle
        compliant = float(result.mounted.compliance) != 0
        rig = f"The rig is {'compliant, see series_compliance' if compliant else 'assumed rigid'}."
        law = f"Bladder law: {described(muscle.material)}"
        if isinstance(muscle, famjax.EquilibriumMuscle):
            return [
                law,
                f"Geometry: {described(muscle)} {rig}",
                "The shape is stable at every loaded reading (smallest stiffness "
                f"{certificate.shape_margin / 1e3:.3g} N/mm). The force is not linear in the law, so the "
                "optimum is the best one found and has no certificate.",
                *([] if result.pictures is None else [result.pictures.summary()]),
                _WITHIN,
            ]
        # The margin of an active constraint is zero within rounding.
        stable = certificate.stability_margin >= -1e-9 * float(np.abs(result.coefficients).max())
        margin = Quantity(certificate.stability_margin, "stress", 3).in_units(system)
        terms = [described(one).partition(". ")[0] for one in terms_of(muscle)]
        return [
            law,
            f"Geometry: {described(muscle.geometry)} {rig}",
            f"Force terms: {'; '.join(one.rstrip('.') for one in terms)}. No friction.",
            f"The law is {'' if stable else 'NOT '}Drucker-stable on the actuation path (margin "
            f"{margin}). Its coefficients are globally optimal for this geometry (KKT residual "
            f"{certificate.kkt_residual:.0e}).",
            _WITHIN,
        ]

    def tables(self, system: str = "metric") -> list[Table]:
        """Return the tables of a fit."""
        return [
            *([] if self.choice is None else [choice_table(self.choice, system)]),
            _parameter_table(self.result, system),
            *evidence_tables(self.evidence, self.result, system),
            _quality_table(self.result, system),
        ]

    def notes(self, system: str = "metric") -> tuple[str, ...]:
        """Return the notes to the summary: choice, further reasons, warnings, bands."""
        choice, error = self.choice, self.evidence.error
        found = (
            *(() if choice is None else (choice.clear, *choice.dropped)),
            *self.judged.reasons[2:],
            *(one for one in self.result.warnings if one not in self.judged.reasons),
            *evidence_warnings(self.evidence, self.result),
            *(() if error is None else (f"The 95 % bands of predictions cover {error.covers}.",)),
        )
        return tuple(sentence_in_units(one, system) for one in found)

    def html(self, system: str = "metric") -> str:
        """Return verdict, table and figure as HTML for a notebook."""
        figure = Figure(figsize=(6, 3.6), layout="constrained")
        plot_isobars(self.result, figure.subplots(), system)
        return as_html(self.result.data.specimen.name, self.summary(system), figure)


def _with_error(one: Estimate, system: str) -> str:
    """Format a parameter with its error to two digits: `braid_diameter 27.335 +- 0.087 mm`."""
    unit = unit_system(system)[one.kind]
    value, error = (from_si(v, unit, one.kind) for v in (one.value, one.stderr))
    if one.fixed or one.at_bound or not (math.isfinite(error) and error > 0):
        return f"{one.name} {_number(value)} {unit}".rstrip() + f" ({_spread(one, error)})"
    places = 1 - math.floor(math.log10(error))
    value, error = (f"{round(v, places):.{max(places, 0)}f}" for v in (value, error))
    return f"{one.name} {value} +- {error} {unit}".rstrip()


def _parameter_table(result: Identification, system: str) -> Table:
    rows = []
    for estimate in result.all_estimates + result.derived:
        unit = unit_system(system)[estimate.kind]
        value, low, high, error = (
            from_si(v, unit, estimate.kind)
            for v in (estimate.value, estimate.min, estimate.max, estimate.stderr)
        )
        rows.append((estimate.name, _number(value), unit, _spread(estimate, error),
                     "" if math.isinf(low) or estimate in result.derived
                     else f"{_number(low)} to {_number(high)}"))  # fmt: skip
    return "Parameters", ("parameter", "value", "unit", "std. error", "bounds"), rows


def _spread(estimate: Estimate, error: float) -> str:
    if estimate.fixed:
        return "held"
    if estimate.at_bound:
        return "at bound"
    return f"{error:.2g}" if math.isfinite(error) else "none"


def _number(value: float) -> str:
    return "0" if abs(value) < 1e-12 else f"{value:.5g}"


def _quality_table(result: Identification, system: str) -> Table:
    errors, certificate = result.errors, result.certificate

    def force(value: float) -> str:
        shown = Quantity(value, "force").in_units(system)
        return f"{shown}, {100 * value / errors.max_force:.3g} % of the largest force"

    moduli = {
        "smallest modulus along the actuation path (Drucker >= 0)": certificate.stability_margin,
        "smallest tangent modulus on the strain range": certificate.slope_margin,
    }
    optimum = [
        ("KKT residual of the convex fit", f"{certificate.kkt_residual:.1e}"),
        ("duality gap of the convex fit", f"{certificate.duality_gap:.1e}"),
    ]
    if result.has_shape:
        margin = f"{certificate.shape_margin / 1e3:.4g} N/mm"
        optimum = [("smallest stiffness of the shape (stable > 0)", margin)]
    active = "; ".join(sentence_in_units(one, system) for one in result.active_constraints)
    rows = [
        ("readings", f"{errors.n_points} loaded; {errors.n_slack} slack (censored)"),
        ("RMSE", force(errors.rmse)),
        ("MAE", force(errors.mae)),
        ("largest error", force(errors.max)),
        *((name, Quantity(value, "stress").in_units(system))
          for name, value in moduli.items() if not math.isnan(value)),
        ("largest strain used", f"{result.strain_range:.4g}"),
        ("active constraints", active or "none"),
        *optimum,
        ("gradient residual of the geometry", f"{certificate.gradient_residual:.1e}"),
        ("condition number of the parameters", f"{certificate.condition:.3g}"),
        ("starts that reached this optimum", f"{certificate.n_agreeing} of {certificate.n_starts}"),
    ]  # fmt: skip
    return "Errors and certificate", ("quantity", "value"), rows


_GRID = 41, 25
"""Number of lengths and pressures of the sliders on a page."""


@dataclasses.dataclass(frozen=True)
class Live:
    """Model values at every position of the sliders on a page.

    Attributes:
        json: values as `famjax predict` prints them, and the outline of the muscle.
        units: units of length, pressure and force.
    """

    json: Markup
    units: Mapping[str, str]

    @classmethod
    def of(cls, result: Identification, system: str) -> "Live":
        """Evaluate an identified muscle over the range of its readings."""
        units, data = unit_system(system), result.data

        def places(kind: str, low: float, high: float, count: int) -> list[str]:
            ends = from_si(low, units[kind], kind), from_si(high, units[kind], kind)
            between = [f"{one:.4g}" for one in np.linspace(*ends, count)[1:-1]]
            return list(dict.fromkeys((f"{ends[0]:.5g}", *between, f"{ends[1]:.5g}")))

        pulls, levels = data.loaded, np.unique(data.pressures.level[data.loaded])
        shown = levels[:: max(1, levels.size // _CURVES)]
        length = places("length", data.length.min(), data.length.max(), _GRID[0])
        steps = places("pressure", levels.min(), levels.max(), _GRID[1])
        read = [f"{from_si(one, units['pressure'], 'pressure'):.5g}" for one in shown]
        pressure = sorted({*steps, *read}, key=float)
        L, P = np.meshgrid(
            *(np.array([float(one) for one in of]) * factor(units[kind], kind)
              for kind, of in (("length", length), ("pressure", pressure))), indexing="ij",
        )  # fmt: skip
        rows = static_rows(result, L.ravel(), P.ravel())

        def table(key: str) -> list[list[str | None]]:
            text = [
                None if row[key] is None else f"{from_si(row[key], units['force'], 'force'):.5g}"
                for row in rows
            ]
            return np.reshape(np.array(text, object), L.shape).tolist()

        radius, angle = _middle(result.muscle, L, P)
        used = {kind: units[kind] for kind in ("length", "pressure", "force")}
        size, rest = factor(units["length"], "length"), data.specimen.rest_length
        points = [getattr(data, kind)[pulls] / factor(unit, kind) for kind, unit in used.items()]
        content = {
            "length": length, "pressure": pressure, "units": used,
            "force": table("force_N"), "low": table("low_95_N"), "high": table("high_95_N"),
            "radius": _known(radius / size), "angle": _known(angle),
            "rest": rest / size,
            "rest_radius": float(np.nanmin(radius)) / size,
            "shown": [pressure.index(one) for one in read],
            "points": np.stack(points, axis=1)[:_SINGLE].round(6).tolist(),
        }  # fmt: skip
        text = json.dumps(content, allow_nan=False, separators=(",", ":"))
        return cls(Markup(text), used)


def _middle(
    muscle: famjax.Muscle | famjax.EquilibriumMuscle, length: np.ndarray, pressure: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Radius [m] and braid angle [rad] halfway between the fittings."""
    if isinstance(muscle, famjax.Muscle):
        at = muscle.geometry.dimensions(length, pressure)
        return np.asarray(at.radius), np.asarray(at.braid_angle)
    shape = muscle.profile(length, pressure, 3)
    return np.asarray(shape.radius[..., 1]), np.asarray(shape.braid_angle[..., 1])


def _known(values: Array | np.ndarray) -> list[list[float | None]]:
    """Round each value to four digits; None for nan."""
    rows = np.asarray(values, float)
    return [[float(f"{one:.4g}") if math.isfinite(one) else None for one in row] for row in rows]


def html_report(
    found: Findings,
    system: str = "metric",
    figure: Figure | None = None,
    origin: Origin | None = None,
) -> str:
    """Return the report as one self-contained HTML page; pass the `figure` of `plot_fit` to reuse it."""
    result = found.result
    drawn = plot_fit(result, system) if figure is None else figure
    profiles = None
    if result.pictures is not None:
        drawn_profiles = as_svg(plot_profiles(result.pictures, system))
        profiles = inline_svg(drawn_profiles, "profiles", "photographed and computed profiles")
    content = [found.numbers(system), *found.tables(system), specimen_table(result, system)]
    return page(
        "report.html",
        found=found,
        system=system,
        figure=inline_svg(as_svg(drawn), "fit", "isobars, residuals and the bladder's law"),
        profiles=profiles,
        tables=[PageTable(*table).html(k) for k, table in enumerate(content, start=1)],
        terms={type(one).__name__ for one in terms_of(result.muscle)},
        origin=origin,
        versions=versions(),
        live=Live.of(result, system),
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
    """Write `fit.json`, `fit.png` and `report.html`, all or none.

    Args:
        result: result of `identify`.
        folder: output folder, created if missing; files of an earlier fit are replaced.
        system: units of figure and report; `fit.json` is in SI.
        evidence: validation and uncertainty, if available.
        origin: date and command to record in file and report.
        choice: choice that the result comes from, if any.
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
