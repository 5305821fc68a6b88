"""Write the report: an HTML page with a summary and figures, and CSV files with the tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd

from famjax.boundary.files import Origin, as_svg
from famjax.boundary.units import sentence_in_units
from fitting.prediction import static_rows
from fitting.report import PageTable, inline_svg, page
from fitting.saved import versions

from .. import evaluation
from ..checks import AGREES
from ..folder import SHEET, Sheet
from .figures import FIGURES, STYLE
from .source import Source, parameter_kind, read_source

_CHECKS = (
    "Cross-checks between two sources of one quantity. Expected ranges are based on standard errors, or on "
    "fixed limits for a muscle and its braid."
)
_TEST = "Test data. Left: force against contraction at each set pressure. Right: pressure error."
_HEADER = ("quantity", "expected", "found", "verdict")
_GEOMETRIC = ("turns", "braid_angle", "braid_diameter")
"""Geometric parameters; the summary shows the first one that was identified."""


def write_report(sheet: Sheet, names: Sequence[str], place: Path) -> None:
    """Write `report.html`, its figures as SVG and its tables as CSV.

    Args:
        sheet: sheet in the folder.
        names: names of the fitted geometries.
        place: folder for the report.
    """
    source, system = read_source(sheet, names), sheet.units
    files = {f"tables/{name}.csv": source.csv(name) for name in source.tables}
    drawn = _drawn(source)
    checks = evaluation.checks_of(sheet)
    doubts = [one.sentence() for one in checks if one.verdict != AGREES]
    texts = [(one.what, one.range, one.value, one.verdict) for one in checks]
    rows = [[sentence_in_units(text, system) for text in row] for row in texts]
    shown = [_errors(source), *([PageTable(_CHECKS, _HEADER, rows, text=True)] if rows else [])]
    document = source.fits[source.best].document
    reasons = "".join(f": {one}" for one in document["reasons"][:1])
    agreeing = f" {len(checks) - len(doubts)} of {len(checks)} cross-checks agree."
    text = page(
        "characterisation.html", "famjax.app",
        name=sheet.specimen.name,
        verdict=sentence_in_units(f"{document['verdict'].capitalize()}{reasons or '.'}", system)
        + f" This report shows the fit with the {source.best} geometry.{agreeing if checks else ''}",
        good=document["verdict"] != "not identified",
        summary=_summary(source),
        numbers=five_numbers(source).html(1),
        next=[sentence_in_units(one, system) for one in (*unknown(sheet), *doubts)],
        figures=[(inline_svg(svg, name, said), said) for name, (svg, said) in drawn.items()],
        tables=[one.html(k) for k, one in enumerate(shown, start=2)],
        notes=[*dict.fromkeys(sentence_in_units(one, system) for one in _notes(source))],
        files=[*files], origin=Origin.of_this_command(), versions=versions(),
    )  # fmt: skip
    files |= {f"figures/{name}.svg": svg for name, (svg, _) in drawn.items()}
    for name, content in (files | {"report.html": text}).items():
        (place / name).parent.mkdir(exist_ok=True)
        (place / name).write_text(content, encoding="utf-8")


def _drawn(source: Source) -> dict[str, tuple[str, str]]:
    """Draw every figure for which the folder contains data; return SVG text and caption by name."""
    found = {}
    with mpl.rc_context(STYLE):
        for draw in FIGURES:
            if (drawn := draw(source)) is not None:
                found[draw.__name__.replace("_", "-")] = as_svg(drawn[0]), drawn[1]
    test = source.sheet.results / evaluation.RECORDS / "characterisation.svg"
    if test.exists():
        found["test"] = test.read_text(encoding="utf-8"), _TEST
    return found


def _summary(source: Source) -> str:
    """Return a summary of the page in two sentences."""
    of, unit, surface = source.figures[source.best], source.unit("force"), source.surface
    rmse, most = of["rmse_N"], of["largest_force_N"]
    shape = f" The shape was fitted to {len(surface.used)} photographs." if surface else ""
    return (
        f"The RMS error of the model is {source.number(rmse, 'force', 3)} {unit}, "
        f"or {100 * rmse / most:.2g} % of the largest force in the fit "
        f"({source.number(most, 'force')} {unit}).{shape}"
    )


def five_numbers(source: Source) -> PageTable:
    """Tabulate the five main results for the muscle, each with its standard error."""
    fit, pressure = source.fits[source.best], float(source.pressures[-1])
    of, rest = source.figures[source.best], float(source.sheet.specimen.rest_length)
    at_end = source.tables["pressures"].query(f"geometry == '{source.best}'").iloc[-1]
    free = at_end.free_contraction
    lengths = np.array([rest, rest * (1 - free)])[: 1 + np.isfinite(free)]
    said = static_rows(fit, lengths, np.full(lengths.size, pressure))
    std = [row["force_std_N"] or np.nan for row in said] + [np.nan]
    scale = source.scaled(1.0, "force")
    rows = [
        ("blocked force", at_end.blocked_force / scale, std[0], "force"),
        ("free contraction", free, std[1] * scale / abs(at_end.free_slope), "number"),
        ("held-out RMSE", of.get("left_out_pressure_N", np.nan), None, "force"),
    ]
    geometric = [name for name in _GEOMETRIC if np.isfinite(of["std"].get(name, np.nan))]
    elastic = [name for name in of["values"] if name.startswith("E_")]
    rows += [
        (name, of["values"][name], of["std"].get(name), parameter_kind(source, name))
        for name in (*geometric[:1], *elastic[:1])
    ]
    rows.append(("RMSE", of["rmse_N"], None, "force"))  # shown if one of the others is unknown
    rows = [row for row in rows if np.isfinite(row[1])][:5]
    return PageTable(
        f"The muscle in five numbers ({evaluation.GEOMETRIES[source.best]}). Force and contraction are at "
        f"{source.pressure(pressure)}; for the held-out RMSE, each pressure is left out in turn.",
        ("quantity", "value", "standard error", "unit"),
        [(what, source.number(value, kind), source.number(error, kind, 2), source.unit(kind))
         for what, value, error, kind in rows],
    )  # fmt: skip


def _errors(source: Source) -> PageTable:
    """Tabulate the force errors by geometry."""
    keys = ("rmse_N", "largest_N", "left_out_pressure_N", "left_out_length_N")
    rows = [
        (name.replace("-", " "), *(source.number(of.get(key), "force", 3) for key in keys))
        for name, of in source.figures.items()
    ]
    title = (
        f"Force errors [{source.unit('force')}]. The last two columns are the RMSE of readings at held-out "
        "pressures and lengths."
    )
    return PageTable(title, ("geometry", "RMSE", "largest", "each pressure", "each length"), rows)


def _notes(source: Source) -> list[str]:
    """Collect the notes about the fit, the test, the shape and the readings."""
    fit, surface = source.fits[source.best], source.surface
    of_shape = [] if surface is None else surface.summary()
    found = [*source.test.get("notes", []), *of_shape, *fit.data.notes, *fit.document["warnings"]]
    # The map's notes name an option of `famjax fit`; here the sheet has an entry for it.
    return [one.replace("(--specimen ", f"([specimen] in {SHEET}: ") for one in found]


def unknown(sheet: Sheet) -> list[str]:
    """List the data missing from the folder, and what is unknown as a result."""
    pictured, map_alone = sheet.photographs is not None, sheet.records.force_map is not None
    failed: list[Any] = []
    if pictured:
        rows: Any = pd.read_csv(sheet.results / evaluation.PICTURES / "measurements.csv")
        failed = [f"{Path(row.path).name}, {row.error.partition(':')[0]}"
                  for row in rows[rows.error.notna()].itertuples()]  # fmt: skip
    sentences = {
        "There are no photographs, so no strain was measured. The model is a cylinder whose diameter and "
        "braid angle are identified from the force.": not pictured,
        "There is a force map but no journal from the test. Hysteresis, pressure error, and the measured "
        "blocked force and free contraction are unknown.": map_alone,
        "There is no machine log for the photographs. The force and pressure in each photograph are "
        "unknown, and the clock and scale are not checked. The shape is assumed to be the same at all "
        "pressures.": pictured and map_alone,
        "There is no photograph of a ruler. All lengths and diameters depend on the stated scale.":
            sheet.photographs is not None and sheet.photographs.ruler is None,
        "The bladder diameter at rest is not stated. The bladder is assumed to fill the braid, and the "
        "bladder strain depends on this assumption.": pictured and sheet.specimen.bladder_diameter is None,
        "The sheet states no calibration errors, so the standard errors and bands include only scatter and "
        "shape errors.": not sheet.errors.stated(),
        f"{SHEET} does not state the number of turns of a thread, so it is identified from the force. "
        "If you can count the turns, enter the number there.":
            sheet.turns is None and pictured,
        f"{len(failed)} picture{'s' * (len(failed) != 1)} could not be measured: "
        f"{'; '.join(failed[:5])}.": failed,
    }  # fmt: skip
    return [said for said, true in sentences.items() if true]
