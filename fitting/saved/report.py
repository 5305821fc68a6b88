"""The report of a fit: tables of text, shared by the terminal and the HTML report."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from famjax.boundary.files import as_png, write_all
from famjax.boundary.origin import Origin
from famjax.boundary.sentence import Quantity, in_units
from famjax.boundary.units import from_si, unit_system

from ..arguments import check_path
from ..choice import Choice, choice_table
from ..evidence.gathered import Evidence, Table, evidence_tables, evidence_warnings
from ..evidence.left_out import columns_of
from ..posterior.plot import plot_posterior
from ..result import Estimate, Identification, check_identified
from ..verdict.judgement import Judgement, judge
from .fit_file import fit_as_dict, versions
from .fit_plot import plot_fit
from .page import PageTable, inline_svg, page, svg_file
from .report_tables import correlation_tables, specimen_table


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
    reasons = [in_units(one, system) for one in judged.reasons]
    said = " ".join(filter(None, (said, *reasons[:1], in_units(judged.unchecked, system))))
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
    return tuple(in_units(one, system) for one in found)


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
         "; ".join(in_units(one, system) for one in result.active_constraints) or "none"),
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
    """Write `fit.json`, `fit.png`, `report.html` and, of a posterior, `posterior.png`, all or none.

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
    if evidence is not None and evidence.posterior is not None:
        files["posterior.png"] = as_png(plot_posterior(evidence.posterior, system))
    return write_all(folder, files)
