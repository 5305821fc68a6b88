"""The report: a page with summary and figures, tables as CSV, and digests of the inputs."""

import importlib.metadata
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import xarray

from famjax.boundary.files import Origin, as_svg, write_all
from famjax.boundary.units import sentence_in_units
from fitting.prediction import static_rows
from fitting.report import PageTable, inline_svg, page
from fitting.saved import versions

from ..checks import AGREES, checks_table, doubts, read_checks
from ..evaluation import CYLINDER, ELASTIC, PICTURES, RECORDS, REPORT, shown_pictures
from ..folder import SHEET, FolderStep, Sheet, digest
from .figures import FIGURES, STYLE, by_level
from .source import KINDS, Source, read_source

_UNITS = {"Pa": "stress", "m": "length", "rad": "angle", "": "number"}
"""Kind of an identified parameter, by its SI unit."""


def tables(source: Source) -> dict[str, str]:
    """Return the tables as CSV by file name; unknown values are empty."""
    found = {
        "states": pd.concat([_states(source, name) for name in source.fits]),
        "readings": _readings(source),
        "parameters": _parameters(source),
        "errors": pd.concat([_errors(source, name) for name in source.fits]),
        "pressures": _pressures(source),
        "work": pd.concat([_work(source, name) for name in source.fits]),
        "checks": _checks(source),
    }
    return {
        f"{name}.csv": table.to_csv(index=False, float_format="%.8g", lineterminator="\n")
        for name, table in found.items()
    }


def _table(source: Source, kinds: dict[str, str], columns: dict[str, Any]) -> pd.DataFrame:
    """Convert columns from SI to the report's units and add the unit to each name."""
    found = pd.DataFrame(columns)
    for name, kind in kinds.items():
        found[name] = source.scaled(found[name].astype(float), kind)
    units = {name: f"{name}_{source.unit(kind)}".rstrip("_") for name, kind in kinds.items()}
    return found.rename(columns=units)


def _states(source: Source, name: str) -> pd.DataFrame:
    """Tabulate the states of a model over contraction at every pressure."""
    of = source.fits[name].states
    columns = xarray.merge([of[[*KINDS]], of.terms.to_dataset("term")]).to_dataframe().reset_index()
    columns.columns = [one.replace(", ", " ").replace(" ", "_") for one in columns.columns]
    kinds = {one: KINDS.get(one, "force") for one in columns.columns if one != "contraction"}
    return _table(source, kinds | {"pressure": "pressure"}, {"geometry": name, **columns})


def _readings(source: Source) -> pd.DataFrame:
    """Tabulate the loaded readings with the model's force, its 95 % band and the residuals."""
    fit = source.best
    data, pulls = fit.data, np.flatnonzero(fit.data.loaded)
    found = static_rows(fit.saved, data.length[pulls], data.pressure[pulls])
    said = {"model": "force_N", "low_95": "low_95_N", "high_95": "high_95_N"}
    columns = {
        **{name: getattr(data, name)[pulls] for name in ("pressure", "length", "force")},
        **{name: [row[key] for row in found] for name, key in said.items()},
        "model_less_measured": fit.residuals,
    }
    kinds = dict.fromkeys(columns, "force") | {"pressure": "pressure", "length": "length"}
    return _table(source, kinds, columns)


def _parameters(source: Source) -> pd.DataFrame:
    """Tabulate the identified parameters of each geometry, with standard errors by source."""
    rows = []
    for fit in source.fits.values():
        of, entries = fit.figures, fit.saved.document["parameters"]
        for name, value in of["values"].items():
            entry = entries.get(name, {})
            if entry.get("fixed"):
                continue
            kind = parameter_kind(source, name)
            numbers = {"value": value, "std": of["std"], "std_of_scatter": of["std_of_scatter"]}
            numbers |= {f"std_of_{one}": shared for one, shared in of["std_by_source"].items()}
            rows.append(
                {"geometry": fit.name, "parameter": name, "unit": source.unit(kind),
                 "at_bound": bool(entry.get("at_bound"))}
                | {key: source.scaled(float(one if key == "value" else one.get(name, np.nan)), kind)
                   for key, one in numbers.items()}
            )  # fmt: skip
    return pd.DataFrame(rows)


def parameter_kind(source: Source, name: str) -> str:
    """Return the kind of quantity of an identified parameter."""
    entries = [fit.saved.document["parameters"].get(name) for fit in source.fits.values()]
    unit = next((str(one["unit"]) for one in entries if one is not None), "")
    return "pressure" if unit == "Pa" and name.endswith("pressure") else _UNITS.get(unit, unit)


def _errors(source: Source, name: str) -> pd.DataFrame:
    """Tabulate RMSE and largest error of a geometry, overall, by pressure and held-out."""
    of, kinds = source.fits[name].figures, ("rmse", "largest", "rmse_left_out")
    every = (of["rmse_N"], of["largest_N"], of.get("left_out_pressure_N"))
    levels = by_level(source.fits[name])
    held = [f"{source.scaled(level, 'pressure'):.8g}" for level in levels]
    columns = zip(kinds, zip(every, *levels.values(), strict=True), strict=True)
    first = {"geometry": name, f"pressure_{source.unit('pressure')}": ["all", *held]}
    return _table(source, dict.fromkeys(kinds, "force"), {**first, **dict(columns)})


def _pressures(source: Source) -> pd.DataFrame:
    """Tabulate blocked force and free contraction by pressure: measured and modelled."""
    seen = source.isobars or [{}] * source.pressures.size
    columns: dict[str, Any] = {"pressure": source.pressures}
    for name, of in {"": None, **{f"_{k}": fit.states for k, fit in source.fits.items()}}.items():
        for what, key in (("blocked_force", "blocked_force_N"), ("free_contraction",) * 2):
            measured = [bar.get(key) for bar in seen]
            columns[f"{what}{name}"] = measured if of is None else of[what].values
    kinds = {one: "force" for one in columns if one.startswith("blocked")}
    return _table(source, {"pressure": "pressure", **kinds}, columns)


def _work(source: Source, name: str) -> pd.DataFrame:
    """Tabulate the work of a geometry's stroke by pressure."""
    work = source.fits[name].work
    energies = {f"{one}_J": getattr(work, one) for one in ("load", "fluid", "stored", "left_over")}
    columns = {**energies, "efficiency": work.efficiency, "work_per_volume_J_m3": work.density}
    columns = {key: np.asarray(values) for key, values in columns.items()}
    given = {"geometry": name, "pressure": source.pressures, **columns}
    return _table(source, {"pressure": "pressure"}, given)


def _checks(source: Source) -> pd.DataFrame:
    header = ["what", "expected", "found", "verdict", "what_to_do"]
    rows = [
        (one.what, one.range, one.value, one.verdict, one.say if one.verdict != AGREES else "")
        for one in read_checks(*source.steps)
    ]
    return pd.DataFrame(rows, columns=header)


FIRST_RUN = "first-run.json"
PAGE, FIGURE_FILES, TABLE_FILES = "report.html", "figures", "tables"
INPUTS, UNKNOWN = "inputs.sha256", "unknown.json"
"""Names in the step's folder."""
_SAME = 1e-6  # relative tolerance of the RMSE
_OPTION = re.compile(r"\(--specimen ([a-z_]+=)\.\.\.(?:, or embedded=false)?\)")
_FURTHER = ("scipy", "matplotlib", "opencv-python-headless", "pillow")
_GEOMETRIC = ("turns", "braid_angle", "braid_diameter")
"""Parameters of the geometry; the summary shows the first that was identified."""


def first_run(results: Path, now: Origin) -> Origin:
    """Return date and command of the folder's first evaluation, used for all its files."""
    path = results / FIRST_RUN
    if not path.exists():
        write_all(results, {FIRST_RUN: (json.dumps(now.as_dict()) + "\n").encode()})
    return Origin(**json.loads(path.read_text(encoding="utf-8")))


def report_step(
    sheet: Sheet, steps: Sequence[FolderStep], *, origin: Origin, system: str
) -> FolderStep:
    """Return the step that writes the report on the steps before it."""
    names = [step.name for step in steps]

    def run(place: Path) -> None:
        _write(read_source(sheet, names, system), origin, place)

    return FolderStep(
        REPORT, [sheet.folder / SHEET], {"system": system}, names, run,
        says=lambda place: json.loads((place / UNKNOWN).read_text(encoding="utf-8")),
    )  # fmt: skip


def _write(source: Source, origin: Origin, place: Path) -> None:
    system, lacking, drawn = source.system, _unknown(source), _drawn(source)
    shown = [
        (inline_svg(svg, name, caption), number, caption)
        for number, (name, svg, caption) in enumerate(drawn, start=1)
    ]
    inputs = "".join(f"{value}  {name}\n" for name, value in _inputs(source.sheet).items())
    found = tables(source)
    text = page(
        "characterisation.html", "famjax.app",
        name=source.sheet.specimen.name,
        verdict=sentence_in_units(_verdict(source), system),
        good=source.best.saved.document.get("verdict") != "not identified",
        summary=_summary(source),
        numbers=five_numbers(source).html(1),
        next=[sentence_in_units(one, system) for one in (*lacking, *doubts(*source.steps))],
        first=shown[0], figures=shown[1:],
        tables=[one.html(k) for k, one in enumerate(_tables(source), start=2)],
        notes=[*dict.fromkeys(sentence_in_units(one, system) for one in _notes(source))],
        files=[f"{TABLE_FILES}/{name}" for name in found],
        origin=origin, inputs=inputs,
        versions=versions() | {name: importlib.metadata.version(name) for name in _FURTHER},
    )  # fmt: skip
    files = {
        PAGE: text, INPUTS: inputs, UNKNOWN: json.dumps(lacking, indent=1) + "\n",
        **{f"{FIGURE_FILES}/{name}.svg": svg for name, svg, _ in drawn},
        **{f"{TABLE_FILES}/{name}": table for name, table in found.items()},
    }  # fmt: skip
    for name, content in files.items():
        (place / name).parent.mkdir(exist_ok=True)
        (place / name).write_text(content, encoding="utf-8")


def _drawn(source: Source) -> list[tuple[str, str, str]]:
    """Draw every figure that the folder has data for: name, SVG file and caption."""
    found = []
    with mpl.rc_context(STYLE):
        for draw in FIGURES:
            if (drawn := draw(source)) is not None:
                found.append((draw.__name__.replace("_", "-"), as_svg(drawn[0]), drawn[1]))
    test = source.sheet.results / RECORDS / "characterisation.svg"
    if test.exists():
        caption = (
            "The test. Left: force against contraction at each set pressure; shortening is solid, "
            "lengthening dashed. Right: held pressure minus set pressure."
        )
        found.insert(1, ("test", test.read_text(encoding="utf-8"), caption))
    return found


def _summary(source: Source) -> str:
    """Summarise the page in two sentences."""
    fit, unit = source.best.figures, source.unit("force")
    rmse, most = fit["rmse_N"], fit["largest_force_N"]
    shape = source.shape
    of = f" The shape comes from {shape['pictures']} photographs." if shape else ""
    return (
        f"The model fits the force within {source.number(rmse, 'force', 3)} {unit} RMS, "
        f"{100 * rmse / most:.2g} % of the largest force, {source.number(most, 'force')} {unit}.{of}"
    )


def _verdict(source: Source) -> str:
    """State the verdict on the displayed fit, its main reason, and the cross-checks."""
    document = source.best.saved.document
    level, reasons = document.get("verdict") or "not judged", document.get("reasons") or []
    checks = [one.verdict == AGREES for one in read_checks(*source.steps)]
    agreeing = f" {sum(checks)} of {len(checks)} cross-checks agree." if checks else ""
    return (
        f"{level.capitalize()}{f': {reasons[0]}' if reasons else '.'} This report shows the "
        f"{source.best.short} fit.{agreeing}"
    )


def five_numbers(source: Source) -> PageTable:
    """Tabulate the five main figures of the muscle, each with its standard error."""
    fit, pressure = source.best, float(source.pressures[-1])
    states, of = fit.states.isel(pressure=-1), fit.figures
    rest = float(source.sheet.specimen.rest_length)
    free = float(states.free_contraction)
    ends = np.array([rest, rest * (1 - free)] if np.isfinite(free) else [rest])
    said = static_rows(fit.saved, ends, np.full(ends.size, pressure))
    std = [row["force_std_N"] or np.nan for row in said] + [np.nan]
    rows = [
        ("blocked force", float(states.blocked_force), std[0], "force"),
        ("free contraction", free, std[1] / abs(float(states.free_slope)), "number"),
        ("RMSE", of["rmse_N"], None, "force"),
        ("RMSE, left out", of.get("left_out_pressure_N"), None, "force"),
    ]
    geometric = [name for name in _GEOMETRIC if np.isfinite(of["std"].get(name, np.nan))]
    elastic = [name for name in of["values"] if name.startswith("E_")]
    rows += [
        (name, of["values"][name], of["std"].get(name), parameter_kind(source, name))
        for name in (*geometric[:1], *elastic[:1])
    ]
    kept = [
        (what, source.number(value, kind), source.number(error, kind, 2), source.unit(kind))
        for what, value, error, kind in rows
        if value is not None and np.isfinite(value)
    ]
    # With six numbers, the held-out RMSE replaces the one in sample.
    del kept[2 : 2 + max(len(kept) - 5, 0)]
    return PageTable(
        f"The muscle in five numbers, {fit.title}. Force and contraction are at "
        f"{source.pressure(pressure)}; the held-out RMSE leaves out each pressure in turn.",
        ("quantity", "value", "standard error", "unit"),
        kept,
    )


def _tables(source: Source) -> list[PageTable]:
    """Tabulate the errors by geometry and the cross-checks."""
    rows = []
    for fit in source.fits.values():
        of = fit.figures
        rmse, largest, *out = (
            source.number(of.get(name), "force", 3)
            for name in ("rmse_N", "largest_N", "left_out_pressure_N", "left_out_length_N")
        )
        share = f"{100 * of['rmse_N'] / of['largest_force_N']:.2g} %"
        rows.append((fit.short, rmse, share, largest, *out))
    header = ("geometry", "RMSE", "of largest force", "largest", "each pressure", "each length")
    groups = (("", 1), ("in sample", 3), ("RMSE, left out", 2))
    title = f"Errors of the force by geometry [{source.unit('force')}]."
    return [
        PageTable(title, header, rows, groups), *checks_table(source.steps, source.system)
    ]  # fmt: skip


def _notes(source: Source) -> list[str]:
    """Collect the notes on fit, test, shape and readings."""
    of_shape = source.shape["notes"] if source.shape else []
    of_fit = source.best.saved.document["warnings"]
    found = [*source.test.get("notes", []), *of_shape, *source.data.notes, *of_fit]
    fits = [source.fits.get(name) for name in (CYLINDER, ELASTIC)]
    known = [one.figures["rmse_N"] for one in fits if one is not None]
    if len(known) > 1 and abs(known[0] - known[1]) <= _SAME * known[0]:
        found.append(
            "Cylinder and elastic cylinder are identical here: braid_compliance, the stretch of the "
            "threads, is at its lower bound of 0. The force of this test shows no stretch of the threads."
        )
    # The map's notes name an option of `famjax fit`; here the sheet has an entry for it.
    return [_OPTION.sub(rf"(\1 in [specimen] of {SHEET})", one) for one in found]


def _unknown(source: Source) -> list[str]:
    """List what the folder lacks and what is unknown as a result."""
    sheet, pictured = source.sheet, PICTURES in source.names
    map_alone, failed = sheet.records.force_map is not None, _failed_pictures(source)
    ruled = sheet.photographs is None or sheet.photographs.ruler is not None
    sentences = {
        "There are no photographs. The model is a cylinder whose diameter and angle are identified from "
        "the force, and no strain was measured.": not pictured,
        "There is a force map and no journal of the test. Hysteresis, pressure error, and the measured "
        "blocked force and free contraction are unknown.": map_alone,
        "The photographs have no machine log. Their forces and pressures are unknown, clock and scale "
        "are unchecked, and one shape is assumed for all pressures.": pictured and map_alone,
        "There is no photograph of a ruler. All lengths and diameters depend on the stated scale.":
            not ruled,
        "The bladder diameter at rest is not stated. The bladder is assumed to fill the braid, which "
        "determines its strain.": pictured and sheet.specimen.bladder_diameter is None,
        "The sheet states no calibration errors. Standard errors and bands include only scatter and shape "
        "errors.": not sheet.errors.stated(),
        "The turns of the threads were not counted. They are identified from the force.":
            sheet.turns is None and pictured,
        f"{len(failed)} picture{'s' * (len(failed) != 1)} could not be measured: "
        f"{'; '.join(failed[:5])}.": failed,
    }  # fmt: skip
    return [said for said, true in sentences.items() if true]


def _failed_pictures(source: Source) -> list[str]:
    """Name the photographs that could not be measured, with the reason."""
    path = source.sheet.results / PICTURES / "measurements.csv"
    if not path.exists():
        return []
    rows = pd.read_csv(path, dtype=str, keep_default_na=False)
    rows = rows[rows["ok"] != "true"]
    return [
        f"{Path(at).name}, {why.partition(':')[0]}"
        for at, why in zip(rows.path, rows.error, strict=True)
    ]


def _inputs(sheet: Sheet) -> dict[str, str]:
    """Return the SHA-256 of every input file by its path in the folder."""
    records, photographs = sheet.records, sheet.photographs
    named = [records.journal, records.machine_log, records.force_map]
    pictures = []
    if photographs is not None:
        named.append(photographs.ruler)
        pictures = shown_pictures(sheet, photographs)
    files = [sheet.folder / SHEET, *(sheet.path(name) for name in named if name), *pictures]
    return {
        (one.relative_to(sheet.folder) if one.is_relative_to(sheet.folder) else one).as_posix():
            digest(one)
        for one in files
    }  # fmt: skip
