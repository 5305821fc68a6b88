"""The report of a fit: pictures, tables of text for terminal and page, and the page.

Pages are one file each, offline, of one style, on a screen, on a telephone and in print.
"""

import dataclasses
import functools
import io
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
from famjax.boundary.files import Origin, as_png, write_all
from famjax.boundary.units import Quantity, factor, from_si, sentence_in_units, unit_system
from famjax.compile_options import as_arrays, quick_jit

from .arguments import check_path
from .choice import Choice, choice_table
from .evidence import Evidence, Table, evidence_tables, evidence_warnings
from .result import Estimate, Identification, check_identified
from .saved import correlations, fit_as_dict, versions
from .validation import columns_of
from .verdict import Judgement, judge

_SVG_ID = re.compile(r'(\bid="|href="#|url\(#)')


@dataclasses.dataclass(frozen=True)
class PageTable:
    """A table of a page.

    Attributes:
        title: what it shows, with the units that its header does not say.
        header: of the columns.
        rows: cells of text.
        groups: names over several columns, each with their number; "" over none.
        text: the cells are words, not numbers.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    groups: Sequence[tuple[str, int]] = ()
    text: bool = False

    def html(self, number: int | None = None) -> Markup:
        """The table; scrolls sideways by itself where it is wider than the page."""
        label = Markup("") if number is None else Markup(f"<b>Table {number}.</b>")
        return Markup(
            _templates("fitting").get_template("table.html").render(table=self, label=label)
        )


def page(template: str, package: str = "fitting", **values: object) -> str:
    """A page from a template that extends `page.html`.

    Args:
        template: name of a file in the package's folder `templates`.
        package: that has it.
        values: of the template; text is escaped, `markupsafe.Markup` is not.
    """
    return _templates(package).get_template(template).render(**values)


def svg_file(figure: Figure) -> str:
    """The figure as an SVG file, the same bytes every time."""
    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "famjax"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def inline_svg(file: str, name: str, description: str) -> Markup:
    """An SVG file for the inside of a page.

    Args:
        file: its text.
        name: before each of its ids, which are its own then among all figures of the page.
        description: for those who do not see it.
    """
    drawn = _SVG_ID.sub(rf"\g<1>{name}-", file[file.index("<svg") :])
    label = f'<svg role="img" aria-label="{escape(description)}"'
    return Markup(drawn.replace("<svg", label, 1))


@functools.cache
def _templates(package: str) -> jinja2.Environment:
    loaders = [jinja2.PackageLoader(name) for name in dict.fromkeys((package, "fitting"))]
    return jinja2.Environment(autoescape=True, loader=jinja2.ChoiceLoader(loaders))


_COLOURS = mpl.colormaps["viridis"]
_BEYOND = 1.25  # the law is drawn to this multiple of the strain range
_CURVES = 24  # of the model at most: a map may have as many pressures as readings
_SINGLE = 500  # readings that a page has one by one; more are a picture in it


def plot_fit(result: Identification, system: str = "metric") -> Figure:
    """The figure of an identification: isobars, residuals and material law.

    Args:
        result: what `identify` returned.
        system: "si", "metric" or "us".

    Returns:
        A figure, not shown; save it with `savefig`.
    """
    check_identified(result)
    figure = Figure(figsize=(11, 6.2))
    FigureCanvasAgg(figure)
    # Places are given: a layout engine draws the figure once more before each drawing.
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
    figure.suptitle(
        f"{result.data.specimen.name}: RMSE {errors.rmse:.3g} N ({errors.rmse_percent:.2g} % of "
        f"{errors.max_force:.5g} N), law: {result.law.name}, constraint: {result.constraint}",
        fontsize=11,
    )
    return figure


def _shade(result: Identification, system: str) -> Normalize:
    """The pressures of a map as colours."""
    levels = result.data.pressures.level / _unit(system, "pressure")
    return Normalize(levels.min(), levels.max())


def _axes(result: Identification, axes: Axes | None) -> Axes:
    """Those given, or those that pyplot draws on."""
    check_identified(result)
    if axes is not None:
        return axes
    from matplotlib import pyplot  # noqa: PLC0415 -- it looks for a screen

    return pyplot.gca()


def _scatter(
    result: Identification, axes: Axes, values: np.ndarray, system: str, **style: Any
) -> None:
    """Loaded readings over their contraction, a colour for each pressure."""
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
    """Force against contraction: the readings and the model, a colour for each pressure.

    Args:
        result: what `identify` returned.
        axes: to draw on; pyplot's current ones unless given.
        system: "si", "metric" or "us".

    Returns:
        The axes.
    """
    axes, shade, data = _axes(result, axes), _shade(result, system), result.data
    force_unit, pressure_unit = _unit(system, "force"), _unit(system, "pressure")
    rest, lengths = (
        data.specimen.rest_length,
        np.linspace(data.length.min(), data.length.max(), 200),
    )
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
        style = {"color": "0.6", "ms": 4, "clip_on": False, "label": "slack (not data)"}
        axes.plot(slack, np.zeros(slack.size), "x", **style)
    axes.set(xlabel="contraction", ylabel=f"force, {unit_system(system)['force']}", ylim=(0, None))
    axes.legend(frameon=False)
    return axes


def plot_residuals(
    result: Identification, axes: Axes | None = None, system: str = "metric"
) -> Axes:
    """Model less reading against contraction, a colour for each pressure; arguments of `plot_isobars`."""
    axes, rmse = _axes(result, axes), result.errors.rmse / _unit(system, "force")
    for level, style in ((0.0, "-"), (rmse, ":"), (-rmse, ":")):
        axes.axhline(level, color="0.7", lw=0.8, ls=style)
    _scatter(result, axes, result.residuals, system, s=14)
    axes.set(xlabel="contraction", ylabel=f"model - measured, {unit_system(system)['force']}")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_title("residuals; dotted: +- RMSE", fontsize=9)
    return axes


def plot_law(result: Identification, axes: Axes | None = None, system: str = "metric") -> Axes:
    """Stress of the bladder against its strain, dashed where it falls; arguments of `plot_isobars`."""
    axes, nodes = _axes(result, axes), result.node_pressures
    strain, material = np.linspace(0, _BEYOND * result.strain_range, 400), result.muscle.material
    if nodes is None:
        pressures = np.zeros(1)
        labels = ["tensile test" if hasattr(material, "uniaxial_stress") else None]
    else:
        pressures = nodes[sorted({0, len(nodes) // 2, len(nodes) - 1})]
        labels = [f"at {pressure / 1e3:.4g} kPa" for pressure in pressures]
    stresses = np.asarray(quick_jit(law_stress)(as_arrays(material), strain, pressures[:, None]))
    for label, stress in zip(labels, stresses / _unit(system, "stress"), strict=True):
        falls = np.gradient(stress, strain) < 0
        (line,) = axes.plot(strain, np.where(falls, np.nan, stress), label=label)
        axes.plot(strain, np.where(falls, stress, np.nan), color=line.get_color(), ls="--")
    axes.axvspan(0, result.strain_range, color="0.92", zorder=0, label="strain range used")
    stress = f"true stress, {unit_system(system)['stress']}"
    axes.set(xlabel="engineering strain", ylabel=stress, xlim=(0, strain[-1]))
    axes.set_title("bladder law; dashed where falling", fontsize=9)
    axes.legend(frameon=False, fontsize=8)
    return axes


def law_stress(
    material: famjax.materials.AbstractMaterial, strain: famjax.Real, pressure: famjax.Real
) -> Float[Array, "pressures strains"]:
    """Stress [Pa] of a tensile test, or where the directions do not interact of either of them."""
    tensile = getattr(material, "uniaxial_stress", None)
    if tensile is not None:
        return tensile(strain)[None]
    return material.stresses(strain, strain, pressure)[0] + 0 * pressure


_TOLD = 0.9
"""Correlation from which two parameters are hard to tell apart."""


def specimen_table(result: Identification, system: str) -> Table:
    """What was known of the muscle, and what was measured on it."""
    data, units = result.data, unit_system(system)

    def shown(value: float, kind: str) -> str:
        return f"{from_si(float(value), units[kind], kind):.5g}"

    rows: list[tuple[str, ...]] = []
    for name, value in dataclasses.asdict(data.specimen).items():
        title = name.replace("_", " ")
        if value is None:
            rows.append((title, "not given", ""))
        elif isinstance(value, bool):
            rows.append((title, "yes" if value else "no", ""))
        elif isinstance(value, str):
            rows.append((title, value, ""))
        else:
            rows.append((title, shown(value, "length"), units["length"]))
    for name in ("length", "pressure", "force"):
        low, high = getattr(data, name).min(), getattr(data, name).max()
        rows.append(
            (f"{name}s measured", f"{shown(low, name)} to {shown(high, name)}", units[name])
        )
    rows.append(("readings", f"{data.force.size}, of which {data.loaded.sum()} pull", ""))
    return "Specimen and readings", ("entry", "value", "unit"), rows


def correlation_tables(result: Identification) -> list[Table]:
    """Correlations of the parameters by linear theory, each of two named once; none for one."""
    names, matrix = correlations(result)
    if len(names) < 2:
        return []
    rows = [
        (name, *(f"{value:+.2f}" for value in line[:k]), *("" for _ in names[k:-1]))
        for k, (name, line) in enumerate(zip(names, matrix, strict=True))
        if k
    ]
    strong = int((np.abs(matrix[np.triu_indices(len(names), 1)]) > _TOLD).sum())
    title = f"Correlations by linear theory ({strong} beyond +-{_TOLD:g})"
    return [(title, ("", *names[:-1]), rows)]


def verdict(
    result: Identification,
    judgement: Judgement | None = None,
    system: str = "metric",
    evidence: Evidence | None = None,
) -> str:
    """Whether the fit may be trusted, with its errors in sample and on what was left out; then why.

    And what could not be checked, as the specimen's description does not say it.
    """
    errors, margin = result.errors, result.certificate.stability_margin
    judged = judge(result) if judgement is None else judgement

    def force(value: float) -> str:
        return Quantity(value, "force", 3).in_units(system)

    held_out = [
        f"{force(value)} on {name}s"
        for name, value in columns_of((evidence or Evidence()).left_out).items()
    ]
    said = (
        f"{judged.level.capitalize()}. RMSE {force(errors.rmse)} ({errors.rmse_percent:.2g} % of the "
        f"largest force) in sample{'; held out: ' * bool(held_out)}{', '.join(held_out)}."
    )
    reasons = [sentence_in_units(one, system) for one in judged.reasons]
    said = " ".join(filter(None, (said, *reasons[:1], sentence_in_units(judged.unchecked, system))))
    if not result.converged:
        return f"NOT converged. {said}"
    if not judged.passed:
        return said
    # A margin at rounding level is that of an active constraint.
    stable = margin >= -1e-9 * float(np.abs(result.coefficients).max())
    law = "Drucker-stable" if stable else "NOT Drucker-stable"
    stress = Quantity(margin, "stress", 3).in_units(system)
    return (
        f"{said} The law is {law} on the whole actuation path (margin {stress}), and its coefficients "
        f"are globally optimal for this geometry (KKT residual {result.certificate.kkt_residual:.0e})."
    )


def tables(
    result: Identification,
    system: str = "metric",
    evidence: Evidence | None = None,
    choice: Choice | None = None,
) -> list[Table]:
    """The tables of a fit, as text in the given unit system."""
    return [
        *([] if choice is None else [choice_table(choice, system)]),
        _parameter_table(result, system),
        _error_table(result, system),
        *evidence_tables(evidence or Evidence(), result, system),
        _certificate_table(result, system),
    ]


def notes(
    result: Identification,
    evidence: Evidence | None = None,
    choice: Choice | None = None,
    judgement: Judgement | None = None,
    system: str = "metric",
) -> tuple[str, ...]:
    """All that a reader must know besides the verdict.

    How the model was chosen, further reasons of the verdict, warnings of the fit, and where
    validation and uncertainty speak against it.
    """
    judged = judge(result) if judgement is None else judgement
    error = (evidence or Evidence()).error
    found = (
        *(() if choice is None else (choice.clear, *choice.dropped)),
        *judged.reasons[1:],
        *result.warnings,
        *evidence_warnings(evidence or Evidence(), result),
        *(() if error is None else (f"Bands of predictions, 95 %, are of {error.covers}.",)),
    )
    return tuple(sentence_in_units(one, system) for one in found)


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


def _error_table(result: Identification, system: str) -> Table:
    errors, unit = result.errors, unit_system(system)["force"]
    rows = [
        (name, f"{from_si(value, unit, 'force'):.4g}", f"{100 * value / errors.max_force:.3g} %")
        for name, value in (("RMSE", errors.rmse), ("MAE", errors.mae), ("largest", errors.max))
    ]
    return (
        f"Errors over {errors.n_points} loaded readings ({errors.n_slack} slack ones are censored)",
        ("error", unit, f"of {Quantity(errors.max_force, 'force', 5).in_units(system)}"),
        rows,
    )


def _certificate_table(result: Identification, system: str) -> Table:
    certificate = result.certificate
    rows = [
        ("smallest modulus along the actuation path (Drucker >= 0)",
         Quantity(certificate.stability_margin, "stress").in_units(system)),
        *([] if math.isnan(certificate.slope_margin) else [
            ("smallest tangent modulus on the strain range",
             Quantity(certificate.slope_margin, "stress").in_units(system))]),
        ("largest strain used", f"{result.strain_range:.4g}"),
        ("active constraints",
         "; ".join(sentence_in_units(one, system) for one in result.active_constraints) or "none"),
        ("KKT residual of the convex fit", f"{certificate.kkt_residual:.1e}"),
        ("duality gap of the convex fit", f"{certificate.duality_gap:.1e}"),
        ("gradient residual of the geometry", f"{certificate.gradient_residual:.1e}"),
        ("condition number of the parameters", f"{certificate.condition:.3g}"),
        ("starts that reached this optimum", f"{certificate.n_agreeing} of {certificate.n_starts}"),
    ]  # fmt: skip
    return "Certificate", ("quantity", "value"), rows


def html_report(
    result: Identification,
    system: str = "metric",
    evidence: Evidence | None = None,
    figure: Figure | None = None,
    origin: Origin | None = None,
    *,
    choice: Choice | None = None,
    judgement: Judgement | None = None,
) -> str:
    """The report as one self-contained HTML page; `figure` is that of `plot_fit`, if it is made."""
    judged = judge(result) if judgement is None else judgement
    drawn = plot_fit(result, system) if figure is None else figure
    content = [
        specimen_table(result, system),
        *tables(result, system, evidence, choice),
        *correlation_tables(result),
    ]
    return page(
        "report.html",
        name=result.data.specimen.name,
        good=judged.passed,
        verdict=verdict(result, judged, system, evidence),
        warnings=notes(result, evidence, choice, judged, system),
        figure=inline_svg(svg_file(drawn), "fit", "isobars, residuals and the bladder's law"),
        tables=[PageTable(*table).html(k) for k, table in enumerate(content, start=1)],
        origin=origin,
        seed=result.seed,
        starts=result.certificate.n_starts,
        data=f"data: {result.data.source}, sha256 {result.data.sha256}",
        versions=", ".join(f"{name} {version}" for name, version in versions().items()),
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
        result: what `identify` returned.
        folder: made if it is not there; files of an earlier fit are replaced.
        system: units of picture and report; `fit.json` is in SI.
        evidence: validation and uncertainty, if there are any.
        origin: date and command, which file and report then say.
        choice: of which the result is the chosen family, where it was chosen.
        judgement: the verdict; found from the fit alone unless given.
        problem: by which the fit can be made anew, for `famjax assess`.

    Returns:
        The paths written.

    Raises:
        InputError: the folder cannot be written.
    """
    check_identified(result)
    folder = check_path("folder", folder)
    verdict = {"choice": choice, "judgement": judge(result) if judgement is None else judgement}
    content = json.dumps(
        {**fit_as_dict(result, evidence, origin, **verdict), "problem": problem},
        indent=1,
        allow_nan=False,
    )
    figure = plot_fit(result, system)
    files = {
        "fit.json": content.encode(),
        "fit.png": as_png(figure),
        "report.html": html_report(result, system, evidence, figure, origin, **verdict).encode(),
    }
    return write_all(folder, files)
