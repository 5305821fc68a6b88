"""Steps that turn a folder of measurements into fitted muscles: force, pictures and fits."""

import dataclasses
import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

import famjax
import fitting
from famjax.boundary.errors import InputError
from famjax.boundary.files import Origin, as_svg
from famjax.boundary.tasks import AnyExecutor
from famjax.boundary.units import finite_or_none
from famjax.console import parse_columns
from famjax.geometries import AbstractGeometry
from fitting.evidence import DRAWS, Move, moves_of
from fitting.parameters import Parameter
from fitting.records import read_machine_log, write_dataset
from fitting.report import write_fit
from fitting.shapes import ShapeSurface
from imaging.campaign import Table
from imaging.cli import AddLog
from rig.journal import read_journal, stored_calibration

from .checks import AGREES, Check, read_checks, record_checks, settle
from .folder import Photographs, Sheet, Steps
from .isobaric import analyse, figures, plot_characterisation
from .photographs import add_log, picture_checks, read_log_of_pictures

RECORDS, PICTURES, REPORT = "records", "pictures", "report"
GEOMETRIES = {
    "cylinder": "cylinder with inextensible threads",
    "elastic-cylinder": "cylinder with elastic threads",
    "average-diameter": "cylinder with the measured average diameter",
    "measured": "measured shape",
    "virtual-work": "measured shape, braid force from virtual work",
}
"""Fitted geometries and their descriptions."""
CYLINDER, ELASTIC, AVERAGE, MEASURED, WORK = GEOMETRIES
FORCE_MAP, FIGURES = "dataset.csv", "figures.json"
_COVERED = 0.3  # least part of the readings within the lengths of the pictures
TEST, _CLOCK_MAP, _PRESSURES = "characterisation.json", "dataset-clock.csv", "pressures.csv"


def evaluate(
    sheet: Sheet, *, executor: AnyExecutor | Literal["auto"], tell: Callable[[str], None]
) -> list[str]:
    """Evaluate a folder and write its report, skipping completed steps (see `Steps`).

    Args:
        sheet: sheet in the folder.
        executor: executor that measures the pictures, see `imaging.process`.
        tell: called with one line of text per step.

    Returns:
        One sentence for each item missing from the folder and for each cross-check that does not agree.

    Raises:
        InputError: a file named in the sheet is missing, or the files contradict each other.
    """
    from .report.page import unknown, write_report

    records, photographs = sheet.records, sheet.photographs
    given = (records.journal, records.machine_log, records.force_map)
    inputs = [sheet.path(name) for name in given if name is not None]
    steps = Steps(sheet.results, tell)
    options: list[Any] = [dataclasses.asdict(records), dataclasses.asdict(sheet.errors)]
    options += [dict(sheet.entries), sheet.units]
    steps.run(RECORDS, lambda place: _force(sheet, place), files=inputs, options=options)
    names = [CYLINDER, ELASTIC]
    if photographs is not None:
        _pictures(sheet, photographs, steps, executor)
        names += [AVERAGE, MEASURED, WORK]
    for name in names:
        options = [dataclasses.asdict(sheet.fit), sheet.turns]
        steps.run(name, lambda place, name=name: _fit(sheet, name, place), options=options)
    steps.run(REPORT, lambda place: write_report(sheet, names, place))
    doubts = [f"warning: {one.sentence()}" for one in checks_of(sheet) if one.verdict != AGREES]
    return [*doubts, *unknown(sheet)]


def checks_of(sheet: Sheet) -> list[Check]:
    """Read the cross-checks in a folder."""
    names = [RECORDS] if sheet.photographs is None else [RECORDS, PICTURES]
    return read_checks(*(sheet.results / name for name in names))


def read_map(sheet: Sheet) -> fitting.ForceData:
    """Read the force map written by the first step."""
    return fitting.read_csv(sheet.results / RECORDS / FORCE_MAP, {})


def _force(sheet: Sheet, place: Path) -> None:
    """Convert a journal and a machine log, or a map, to a force map with the specimen in its header."""
    options = dataclasses.asdict(sheet.records)
    names = ("journal", "machine_log", "force_map")
    journal_file, log_file, map_file = (options.pop(name) for name in names)
    columns = parse_columns(options.pop("columns"))
    if map_file is not None:
        given = dataclasses.asdict(sheet.specimen)
        data = fitting.read_csv(sheet.path(map_file), given, columns)
        fitting.write_csv(data, place / FORCE_MAP)
        return
    journal = read_journal(sheet.path(journal_file))
    columns.pop("pressure", None)  # from the journal
    log = read_machine_log(sheet.path(log_file), columns=columns)
    rest_length, sensor = sheet.specimen.rest_length, stored_calibration(journal).pressure
    found = analyse(journal, log, rest_length=rest_length, **options)
    entries = {k: v for k, v in sheet.entries.items() if not k.startswith("rest_length_")}
    write_dataset(found.characterisation, place / FORCE_MAP, specimen=entries)
    apart = found.alignment.offset + found.alignment.offset_error
    alignment = dataclasses.replace(found.alignment, offset=apart)
    moved = analyse(journal, log, rest_length=rest_length, alignment=alignment, **options)
    write_dataset(moved.characterisation, place / _CLOCK_MAP)
    time = np.interp(found.record.time, found.alignment.journal_time(log.time), log.time)
    pressures = pd.DataFrame({"time_s": time, "pressure_Pa": found.record.pressure})
    pressures.to_csv(place / _PRESSURES, index=False, float_format="%.10g")
    errors = {
        "pressure_reading": finite_or_none(sensor.gain_std / sensor.gain),
        "pressure_zero": finite_or_none(sensor.zero_std * sensor.gain),
    }
    numbers = json.dumps(figures(found) | {"errors": errors}, indent=1, allow_nan=False)
    (place / TEST).write_text(numbers + "\n", encoding="utf-8")
    drawn = as_svg(plot_characterisation(found, sheet.units))
    (place / "characterisation.svg").write_text(drawn, encoding="utf-8")
    settle(record_checks(sheet, journal, found), place)


def _pictures(sheet: Sheet, photographs: Photographs, steps: Steps, executor: Any) -> None:
    """Measure the pictures, and add the log and the pressure from the journal (nan in its gaps)."""
    from imaging import Tone
    from imaging.pictures import expand, measure_pictures, picture_recipe

    ruler = None if photographs.ruler is None else sheet.path(photographs.ruler)
    reading = {"pitch": photographs.pitch, "placement_stderr": photographs.ruler_placement}
    tone = None if photographs.tone is None else Tone.srgb()
    choices = reading | {"distance": photographs.distance, "k1": photographs.k1, "tone": tone}
    choices = {name: one for name, one in choices.items() if one is not None}
    recipe, provenance = picture_recipe(ruler, photographs.scale, choices)
    shown = [str(sheet.folder / photographs.pictures)]

    def measure(place: Path) -> None:
        merge, path = None, sheet.records.machine_log
        if path is not None:
            columns = parse_columns(sheet.records.columns)
            log = read_log_of_pictures(sheet.path(path), columns=columns)
            merge = functools.partial(_with_log, add_log(log, photographs.log_offset), sheet)
        table = measure_pictures(
            shown, recipe=recipe, provenance=provenance, add_log=merge, executor=executor,
            rest_length=sheet.specimen.rest_length, system=sheet.units, output=place,
        ).table  # fmt: skip
        settle(picture_checks(sheet, table), place)

    files = [Path(path) for path in expand(shown, without=None if ruler is None else str(ruler))]
    options = [repr(recipe), provenance.get("ruler_sha256"), dataclasses.asdict(photographs)]
    steps.run(PICTURES, measure, files=files, options=options)


def _with_log(merge: AddLog, sheet: Sheet, table: Table) -> Table:
    """Add the log and the pressure from the journal to the table of pictures."""
    table = merge(table)
    if "log_time" not in table.columns or "pressure" in table.columns:
        return table
    pressure = pressure_at(sheet.results / RECORDS / _PRESSURES, table["log_time"])
    return dataclasses.replace(table, columns={**table.columns, "pressure": pressure})


def pressure_at(path: Path, at: np.ndarray) -> np.ndarray:
    """Return the pressure [Pa] in the journal at times [s] on the machine's clock; nan in its gaps."""
    time, pressure = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    after = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    apart = np.minimum(np.abs(at - time[after - 1]), np.abs(at - time[after]))
    known = apart <= 2 * np.median(np.diff(time))
    return np.where(known, np.interp(at, time, pressure), np.nan)


def measured_surface(sheet: Sheet) -> ShapeSurface:
    """Fit the shape surface to the measured pictures."""
    return fitting.shape_surface(sheet.results / PICTURES / "measurements.nc")


def _fit(sheet: Sheet, name: str, place: Path) -> None:
    """Fit one geometry to the force map; write the fit and the values that the report compares."""
    surface = None if name in (CYLINDER, ELASTIC) else measured_surface(sheet)
    result = fit_with(sheet, read_map(sheet), name, surface)
    evidence = fitting.evidence.gather(
        result, validation=True, seed=sheet.fit.seed, progress=lambda *_: None,
        shared=_shared(sheet, result.data, name, surface),
    )  # fmt: skip
    write_fit(result, place, sheet.units, evidence, Origin.of_this_command())
    errors, shared = result.errors, evidence.shared
    values = {one.name: float(one.value) for one in result.estimates}
    scatter = {one.name: float(one.stderr) for one in result.estimates}
    others = {} if shared is None else shared.std
    content: dict[str, Any] = {
        "rmse_N": float(errors.rmse), "largest_N": float(errors.max),
        "largest_force_N": float(errors.max_force), "values": values, "std_of_scatter": scatter,
        "std": {name: float(np.hypot(one, others.get(name, 0.0))) for name, one in scatter.items()},
        "std_by_source": {} if shared is None else shared.by_source(),
        **{f"left_out_{one.groups}_N": float(one.rmse) for one in evidence.validations},
    }  # fmt: skip
    (place / FIGURES).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def fit_with(
    sheet: Sheet, data: fitting.ForceData, name: str, surface: ShapeSurface | None
) -> fitting.Identification:
    """Identify the bladder law using one of the geometries."""
    options = dataclasses.asdict(sheet.fit)
    if sheet.fit.law != "polynomial":
        del options["order"]
    if name == ELASTIC:
        options["parameters"] = {"braid_compliance": Parameter()}
    if surface is None:
        return fitting.identify(data, **options)
    geometry = _geometry(sheet, name, surface, sheet.specimen)
    if name == WORK:
        options["terms"] = famjax.terms.VirtualWork(0.0)
    if sheet.turns is None and name != WORK:
        least, most = surface.threads.turns_range()
        options["parameters"] = {"turns": Parameter(min=least, max=most)}
    return fitting.identify(_within(data, geometry), geometry=geometry, **options)


def _geometry(
    sheet: Sheet, name: str, surface: ShapeSurface | None, specimen: Any, draw: int | None = None
) -> Any:
    """Build a geometry from the measured shape or from one of its random draws; None without a shape."""
    if surface is None:
        return None
    turns = surface.threads.turns if sheet.turns is None else sheet.turns
    braid = famjax.Braid(surface.threads.length, turns, specimen.braid_thickness)
    geometry = surface.geometry(specimen, braid=braid, draw=draw)
    if name == AVERAGE:
        return famjax.measured.AverageDiameterGeometry(geometry.family, geometry.bladder)
    return geometry


def _shared(
    sheet: Sheet, data: fitting.ForceData, name: str, surface: ShapeSurface | None
) -> dict[str, list[Move]]:
    """Collect the errors shared by all readings: sheet, pressure calibration, clock and shape."""
    test, clock = (sheet.results / RECORDS / one for one in (TEST, _CLOCK_MAP))
    known = json.loads(test.read_text(encoding="utf-8"))["errors"] if test.exists() else {}
    known = {name: std for name, std in known.items() if std is not None} | sheet.errors.stated()
    errors = dataclasses.replace(sheet.errors, **known)
    geometry = functools.partial(_geometry, sheet, name, surface)
    moves = moves_of(data, errors, geometry)
    if clock.exists():
        moves["clock"] = [Move(_clock_moved(data, clock), geometry(sheet.specimen))]
    if surface is not None:
        moves["shape"] = [Move(None, geometry(sheet.specimen, draw)) for draw in range(DRAWS)]
    return moves


def _within(data: fitting.ForceData, geometry: AbstractGeometry) -> fitting.ForceData:
    """Return the readings within the photographed lengths, with a note about the others."""
    low, high = (float(end) for end in geometry.length_range())
    inside = (data.length >= low) & (data.length <= high)
    if inside.sum() < max(8, _COVERED * inside.size):
        raise InputError(
            f"only {int(inside.sum())} of {inside.size} force readings lie within the photographed "
            f"lengths, {low * 1e3:.4g} to {high * 1e3:.4g} mm: photograph the whole stroke, or correct "
            "rest_length or the scale of the pictures"
        )
    note = f"{(~inside).sum()} readings outside the photographed lengths were left out."
    kept = data.part(inside)
    return data if inside.all() else dataclasses.replace(kept, notes=(*kept.notes, note))


def _clock_moved(data: fitting.ForceData, path: Path) -> fitting.ForceData:
    """Return the force map for a clock offset that is larger by one standard error."""
    other = fitting.read_csv(path, dataclasses.asdict(data.specimen))
    moved = {name: getattr(data, name).copy() for name in ("force", "pressure", "length")}
    # The end of a stroke may have one reading more or less; readings without a partner stay unchanged.
    near = np.abs(data.length[:, None] - other.length) + np.where(
        np.abs(data.pressures.level[:, None] - other.pressures.level)
        > np.abs(np.diff(np.unique(data.pressures.level), append=np.inf)).min() / 2,
        np.inf, 0.0,
    )  # fmt: skip
    partner = np.argmin(near, axis=1)
    found = near[np.arange(data.force.size), partner] < np.ptp(data.length) / 60
    for name, values in moved.items():
        values[found] = getattr(other, name)[partner[found]]
    return dataclasses.replace(data, **moved)
