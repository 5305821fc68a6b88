"""The report: a page with summary and figures, tables as CSV, and digests of the inputs."""

import csv
import importlib.metadata
import io
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

from famjax.boundary.files import Origin, write_all
from famjax.boundary.sentence import text_in_units
from fitting.prediction import static_rows
from fitting.report import PageTable, inline_svg, page, svg_file
from fitting.saved import versions

from ..checks import AGREES, checks_table, doubts, read_checks
from ..evaluation import CYLINDER, ELASTIC, PICTURES, RECORDS, REPORT, shown_pictures
from ..folder import SHEET, FolderStep, Sheet, digest
from .figures import FIGURES, STYLE, by_level
from .source import Source, failed_pictures, read_source

_STATES = {
    "force": "force", "diameter": "length", "braid_angle": "angle", "thickness": "length",
    "volume": "volume", "axial_strain": "number", "mean_hoop_strain": "number",
    "most_hoop_strain": "number", "axial_stress": "stress", "hoop_stress": "stress",
}  # fmt: skip
"""Fields of `States` and their kinds."""
_KINDS = {"Pa": "stress", "m": "length", "rad": "angle", "": "number"}


def tables(source: Source) -> dict[str, str]:
    """The tables by their files' names."""
    return {
        "states.csv": _states(source),
        "readings.csv": _readings(source),
        "parameters.csv": _parameters(source),
        "errors.csv": _errors(source),
        "pressures.csv": _pressures(source),
        "work.csv": _work(source),
        "checks.csv": _checks(source),
    }


def parameter_kind(source: Source, name: str) -> str:
    """Kind of quantity of an identified number."""
    for fit in source.fits.values():
        entry = fit.saved.document["parameters"].get(name)
        if entry is not None:
            unit = str(entry["unit"])
            pressure = unit == "Pa" and name.endswith("pressure")
            return "pressure" if pressure else _KINDS.get(unit, unit)
    return "number"


def _states(source: Source) -> str:
    """What each model says over contraction, at every pressure."""
    terms = dict.fromkeys(term for fit in source.fits.values() for term in fit.states.terms)
    named = [_column(source, name, kind) for name, kind in _STATES.items()]
    header = ["geometry", _column(source, "pressure", "pressure"), "contraction", *named]
    header += [
        _column(source, term.replace(", ", " ").replace(" ", "_"), "force") for term in terms
    ]
    rows = []
    for fit in source.fits.values():
        of = fit.states
        unknown = np.full(of.force.shape, np.nan)
        columns = [source.scaled(getattr(of, name), kind) for name, kind in _STATES.items()]
        columns += [source.scaled(of.terms.get(term, unknown), "force") for term in terms]
        for k, pressure in enumerate(source.scaled(source.pressures, "pressure")):
            for j, contraction in enumerate(of.contraction):
                rows.append([fit.name, pressure, contraction, *(one[k, j] for one in columns)])
    return _text(header, rows)


def _readings(source: Source) -> str:
    """The readings that pull, with the model's force, its 95 % band and what each geometry leaves."""
    fit = source.best
    data = fit.data
    pulls = np.flatnonzero(data.loaded)
    found = static_rows(fit.saved, data.length[pulls], data.pressure[pulls])
    header = [_column(source, "pressure", "pressure"), _column(source, "length", "length")]
    header += [
        _column(source, name, "force")
        for name in ("force", "model", "low_95", "high_95", "model_less_measured")
    ]
    rows = [
        [source.scaled(data.pressure[k], "pressure"), source.scaled(data.length[k], "length"),
         source.scaled(data.force[k], "force"),
         *(_scaled(source, row[key], "force") for key in ("force_N", "low_95_N", "high_95_N")),
         source.scaled(left, "force")]
        for k, row, left in zip(pulls, found, fit.residuals, strict=True)
    ]  # fmt: skip
    return _text(header, rows)


def _parameters(source: Source) -> str:
    """What was identified with each geometry, with its standard errors by source."""
    sources = dict.fromkeys(
        one for fit in source.fits.values() for one in fit.figures["std_by_source"]
    )
    header = ["geometry", "parameter", "unit", "value", "std", "std_of_scatter"]
    rows = []
    for fit in source.fits.values():
        for name, value in fit.figures["values"].items():
            entry = fit.saved.document["parameters"].get(name, {})
            if entry.get("fixed"):
                continue
            kind = parameter_kind(source, name)
            numbers = (value, fit.figures["std"].get(name), fit.figures["std_of_scatter"].get(name))
            shared = [fit.figures["std_by_source"].get(one, {}).get(name) for one in sources]
            rows.append(
                [fit.name, name, source.unit(kind),
                 *(_scaled(source, one, kind) for one in (*numbers, *shared)),
                 bool(entry.get("at_bound"))]
            )  # fmt: skip
    return _text([*header, *(f"std_of_{one}" for one in sources), "at_bound"], rows)


def _errors(source: Source) -> str:
    """RMSE and largest error of each geometry, over all and at each pressure, and while left out."""
    header = ["geometry", _column(source, "pressure", "pressure")]
    header += [_column(source, one, "force") for one in ("rmse", "largest", "rmse_left_out")]
    rows = []
    for fit in source.fits.values():
        of = fit.figures
        every = {"all": (of["rmse_N"], of["largest_N"], of.get("left_out_pressure_N"))}
        for level, errors in (every | by_level(fit)).items():
            at = level if isinstance(level, str) else source.scaled(level, "pressure")
            rows.append([fit.name, at, *(_scaled(source, one, "force") for one in errors)])
    return _text(header, rows)


def _pressures(source: Source) -> str:
    """Blocked force and free contraction by pressure: measured, and of each geometry."""
    N = source.unit("force")
    header = [_column(source, "pressure", "pressure"), f"blocked_force_{N}", "free_contraction"]
    for fit in source.fits.values():
        header += [f"blocked_force_{fit.name}_{N}", f"free_contraction_{fit.name}"]
    rows = []
    for k, pressure in enumerate(source.pressures):
        bar = source.isobars[k] if source.isobars else {}
        blocked = _scaled(source, bar.get("blocked_force_N"), "force")
        row = [source.scaled(pressure, "pressure"), blocked, bar.get("free_contraction")]
        for fit in source.fits.values():
            free = fit.states.free_contraction()[k]
            row += [source.scaled(fit.states.blocked_force[k], "force"), free]
        rows.append(row)
    return _text(header, rows)


def _work(source: Source) -> str:
    """The work of each geometry's stroke, by pressure."""
    names = ("load", "fluid", "stored", "left_over")
    header = ["geometry", _column(source, "pressure", "pressure"), *(f"{name}_J" for name in names)]
    rows = [
        [fit.name, source.scaled(pressure, "pressure"),
         *(float(getattr(fit.work, name)[k]) for name in (*names, "efficiency", "density"))]
        for fit in source.fits.values()
        for k, pressure in enumerate(source.pressures)
    ]  # fmt: skip
    return _text([*header, "efficiency", "work_per_volume_J_m3"], rows)


def _checks(source: Source) -> str:
    """What two sources say of one thing."""
    found = [one for place in source.steps for one in read_checks(place)]
    rows = [
        (one.what, one.range, one.value, one.verdict, one.say if one.verdict != AGREES else "")
        for one in found
    ]
    return _text(["what", "expected", "found", "verdict", "what_to_do"], rows)


def _column(source: Source, name: str, kind: str) -> str:
    unit = source.unit(kind)
    return f"{name}_{unit}" if unit else name


def _scaled(source: Source, value: float | None, kind: str) -> float | None:
    return None if value is None else source.scaled(float(value), kind)


def _text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """CSV; empty is what is not known."""
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow([_cell(one) for one in row])
    return lines.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, float | np.floating):
        return f"{value:.8g}" if np.isfinite(value) else ""
    return "" if value is None else value


FIRST_RUN = "first-run.json"
PAGE, FIGURE_FILES, TABLE_FILES = "report.html", "figures", "tables"
INPUTS, UNKNOWN = "inputs.sha256", "unknown.json"
"""Names in the step's folder."""
_SAME = 1e-6  # of the RMSE
_OPTION = re.compile(r"\(--specimen ([a-z_]+=)\.\.\.(?:, or embedded=false)?\)")
_FURTHER = ("scipy", "matplotlib", "opencv-python-headless", "pillow")
_GEOMETRIC = ("turns", "braid_angle", "braid_diameter")
"""Identified numbers of the geometry, the first of which the summary shows."""


def first_run(results: Path, now: Origin) -> Origin:
    """When the folder was first evaluated, and by which command: the date of all its files."""
    path = results / FIRST_RUN
    if not path.exists():
        write_all(results, {FIRST_RUN: (json.dumps(now.as_dict()) + "\n").encode()})
    return Origin(**json.loads(path.read_text(encoding="utf-8")))


def report_step(
    sheet: Sheet, steps: Sequence[FolderStep], *, origin: Origin, system: str
) -> FolderStep:
    """The step that writes the report of the steps before it."""
    names = [step.name for step in steps]

    def run(place: Path) -> None:
        _write(read_source(sheet, names, system), origin, place)

    return FolderStep(
        REPORT, [sheet.folder / SHEET], {"system": system}, names, run,
        says=lambda place: json.loads((place / UNKNOWN).read_text(encoding="utf-8")),
    )  # fmt: skip


def _write(source: Source, origin: Origin, place: Path) -> None:
    system, lacking = source.system, _unknown(source)
    drawn = _drawn(source)
    shown = [
        (inline_svg(svg, name, caption), number, caption)
        for number, (name, svg, caption) in enumerate(drawn, start=1)
    ]
    inputs = "".join(f"{value}  {name}\n" for name, value in _inputs(source.sheet).items())
    found = tables(source)
    text = page(
        "characterisation.html", "famjax.app",
        name=source.sheet.specimen.name,
        verdict=text_in_units(_verdict(source), system),
        good=source.best.saved.document.get("verdict") != "not identified",
        summary=_summary(source),
        numbers=five_numbers(source).html(1),
        next=[text_in_units(one, system) for one in (*lacking, *doubts(source.steps))],
        first=shown[0], figures=shown[1:],
        tables=[one.html(k) for k, one in enumerate(_tables(source), start=2)],
        notes=[*dict.fromkeys(text_in_units(one, system) for one in _notes(source))],
        files=[f"{TABLE_FILES}/{name}" for name in found],
        origin=origin, inputs=inputs,
        versions=versions() | {name: importlib.metadata.version(name) for name in _FURTHER},
    )  # fmt: skip
    (place / PAGE).write_text(text, encoding="utf-8")
    (place / INPUTS).write_text(inputs, encoding="utf-8")
    (place / UNKNOWN).write_text(json.dumps(lacking, indent=1) + "\n", encoding="utf-8")
    for folder in (FIGURE_FILES, TABLE_FILES):
        (place / folder).mkdir()
    for name, svg, _ in drawn:
        (place / FIGURE_FILES / f"{name}.svg").write_text(svg, encoding="utf-8")
    for name, table in found.items():
        (place / TABLE_FILES / name).write_text(table, encoding="utf-8")


def _drawn(source: Source) -> list[tuple[str, str, str]]:
    """Name, SVG file and caption of every figure that the folder has."""
    found = []
    with mpl.rc_context(STYLE):
        for draw in FIGURES:
            drawn = draw(source)
            if drawn is not None:
                found.append((draw.__name__.replace("_", "-"), svg_file(drawn[0]), drawn[1]))
    test = source.results / RECORDS / "characterisation.svg"
    if test.exists():
        caption = (
            "The test. Left: force against contraction at each set pressure, shortening solid, "
            "lengthening dashed. Right: the pressure held less the set pressure."
        )
        found.insert(1, ("test", test.read_text(encoding="utf-8"), caption))
    return found


def _summary(source: Source) -> str:
    """The page in a sentence."""
    fit = source.best.figures
    rmse, most = fit["rmse_N"], fit["largest_force_N"]
    of = "" if source.shape is None else f", its shape from {source.shape['pictures']} photographs"
    unit = source.unit("force")
    return (
        f"{source.sheet.specimen.name}: the force is described within "
        f"{source.number(rmse, 'force', 3)} {unit} RMS, {100 * rmse / most:.2g} % of the largest, "
        f"{source.number(most, 'force', 4)} {unit}{of}."
    )


def _verdict(source: Source) -> str:
    """Whether the fit that the page shows may be believed, the gravest reason first, and the checks."""
    document = source.best.saved.document
    level, reasons = document.get("verdict") or "not judged", document.get("reasons") or []
    checks = [one for place in source.steps for one in read_checks(place)]
    agreeing = sum(one.verdict == AGREES for one in checks)
    return " ".join(
        [
            f"{level.capitalize()}{f': {reasons[0]}' if reasons else '.'}",
            f"Shown is the {source.best.short} fit.",
            f"{agreeing} of {len(checks)} cross-checks agree." if checks else "",
        ]
    ).strip()


def five_numbers(source: Source) -> PageTable:
    """The five main figures of a muscle, each with its standard error."""
    fit, pressure = source.best, float(source.pressures[-1])
    states, saved = fit.states, fit.saved
    at = source.pressure(pressure)
    free = float(states.free_contraction()[-1])
    ends = (states.rest_length, states.rest_length * (1 - free) if np.isfinite(free) else np.nan)
    std = [
        static_rows(saved, np.array([length]), np.array([pressure]))[0]["force_std_N"]
        if np.isfinite(length)
        else None
        for length in ends
    ]
    slope = abs(float(np.gradient(states.forces[-1], 1 - states.lengths / states.rest_length)[
        int(np.argmin(np.abs(states.lengths - ends[1])))])) if np.isfinite(free) else np.nan  # fmt: skip
    out = fit.figures.get("left_out_pressure_N")
    rows = [
        _row(source, "blocked force", float(states.blocked_force[-1]), std[0], "force"),
        _row(source, "free contraction", free,
             None if std[1] is None else std[1] / slope, "number"),
        _row(source, "RMSE", fit.figures["rmse_N"], None, "force"),
        _row(source, "RMSE, left out", out, None, "force"),
    ]  # fmt: skip
    values, errors = fit.figures["values"], fit.figures["std"]
    geometric = [name for name in _GEOMETRIC if np.isfinite(errors.get(name, np.nan))]
    elastic = [name for name in values if name.startswith("E_")]
    for name in (*geometric[:1], *elastic[:1]):
        rows.append(
            _row(source, name, values[name], errors.get(name), parameter_kind(source, name))
        )
    # The error on readings left out stands for that in sample where both would be a sixth number.
    kept = [row for row in rows if row[1] != source.number(None)]
    del kept[2 : 2 + max(len(kept) - 5, 0)]
    return PageTable(
        f"The muscle in five numbers, {fit.title}: force and contraction at {at}; left out is each "
        "pressure in turn.",
        ("quantity", "value", "standard error", "unit"),
        kept,
    )


def _row(
    source: Source, what: str, value: float | None, std: float | None, kind: str
) -> tuple[str, ...]:
    return (what, source.number(value, kind), source.number(std, kind, 2), source.unit(kind))


def _tables(source: Source) -> list[PageTable]:
    """Errors by geometry, and the cross-checks."""
    unit = source.unit("force")
    rows = [
        (
            fit.short,
            source.number(fit.figures["rmse_N"], "force", 3),
            f"{100 * fit.figures['rmse_N'] / fit.figures['largest_force_N']:.2g} %",
            source.number(fit.figures["largest_N"], "force", 3),
            source.number(fit.figures.get("left_out_pressure_N"), "force", 3),
            source.number(fit.figures.get("left_out_length_N"), "force", 3),
        )
        for fit in source.fits.values()
    ]
    header = ("geometry", "RMSE", "of largest force", "largest", "each pressure", "each length")
    groups = (("", 1), ("in sample", 3), ("RMSE, left out", 2))
    errors = PageTable(f"Errors of the force by geometry [{unit}].", header, rows, groups)
    return [errors, *checks_table(source.steps, source.system)]


def _notes(source: Source) -> list[str]:
    """What a reader must know of fit, test, shape and readings."""
    of_shape = source.shape["notes"] if source.shape else []
    of_fit = source.best.saved.document["warnings"]
    found = [*source.test.get("notes", []), *of_shape, *source.data.notes, *_alike(source)]
    # A force map advises an option of `famjax fit`; here the same stands in the sheet.
    return [_OPTION.sub(rf"(\1 in [specimen] of {SHEET})", one) for one in (*found, *of_fit)]


def _alike(source: Source) -> list[str]:
    """Why the columns of cylinder and elastic cylinder are the same, where they are."""
    fits = [source.fits.get(name) for name in (CYLINDER, ELASTIC)]
    known = [one.figures["rmse_N"] for one in fits if one is not None]
    if len(known) < 2 or abs(known[0] - known[1]) > _SAME * known[0]:
        return []
    return [
        "Cylinder and elastic cylinder are the same here: the stretch of the threads, braid_compliance, "
        "was identified as 0, its lower bound. The force of this test shows no stretch of the threads."
    ]


def _unknown(source: Source) -> list[str]:
    """What the folder lacks, and what is not known therefore."""
    sheet, said = source.sheet, []
    pictured = PICTURES in source.names
    if not pictured:
        said.append(
            "There are no photographs: the shape is the cylinder of the braid's triangle, its "
            "diameter and angle identified from the force, and no strain was measured."
        )
    if sheet.records.force_map is not None:
        said.append(
            "There is a force map and no record of the test: hysteresis, the pressure that was held, "
            "blocked force and free contraction as measured are not known."
        )
        if pictured:
            said.append(
                "The photographs have no log beside them: force and pressure at each are not known, "
                "their clock and scale are not checked, and the shape is taken as one at all pressures."
            )
    if sheet.photographs is not None and sheet.photographs.ruler is None:
        said.append(
            "There is no photograph of a ruler: the scale of the pictures is as stated, and all "
            "lengths and diameters are as wrong as it is."
        )
    if pictured and sheet.specimen.bladder_diameter is None:
        said.append(
            "The bladder's diameter at rest is not stated: it is taken to fill the braid, and its "
            "strain is as wrong as that."
        )
    if not sheet.errors.stated():
        said.append(
            "The sheet states no errors that all readings share: standard errors and bands are of "
            "scatter and shape alone."
        )
    if sheet.turns is None and pictured:
        said.append(
            "The turns of the threads were not counted: they are identified from the force."
        )
    if failed := failed_pictures(source):
        count = "1 picture" if len(failed) == 1 else f"{len(failed)} pictures"
        said.append(f"{count} could not be measured: {'; '.join(failed[:5])}.")
    return said


def _inputs(sheet: Sheet) -> dict[str, str]:
    """SHA-256 of every file of the folder that the evaluation reads, by its path in the folder."""
    records, photographs = sheet.records, sheet.photographs
    named = [records.journal, records.machine_log, records.force_map]
    if photographs is not None:
        named += [photographs.ruler, photographs.recipe]
    files = [sheet.folder / SHEET, *(sheet.path(name) for name in named if name is not None)]
    if photographs is not None:
        files += shown_pictures(sheet, photographs)
    return {
        (
            path.relative_to(sheet.folder) if path.is_relative_to(sheet.folder) else path
        ).as_posix(): digest(path)
        for path in files
    }
