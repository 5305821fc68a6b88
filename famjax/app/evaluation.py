"""The steps from a folder to fitted muscles: force, pictures, shape, fits."""

import dataclasses
import functools
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

import famjax
import fitting
from famjax.boundary.errors import InputError
from famjax.boundary.files import Origin, as_svg
from famjax.boundary.tasks import AnyExecutor
from famjax.console import parse_columns
from fitting.evidence import DRAWS, Evidence, Move, SharedErrors, moves_of
from fitting.parameters import Parameter
from fitting.records import MachineLog, read_machine_log, write_dataset
from fitting.report import write_fit
from imaging.campaign import PARTS, Table
from rig.calibration import Calibration
from rig.journal import read_journal, stored_calibration

from .checks import record_checks, settle, specimen_checks, warnings_of
from .folder import FolderStep, Photographs, Sheet
from .isobaric import Analysis, analyse, branches_csv, figures, plot_characterisation
from .photographs import add_log, picture_checks, read_log_of_pictures

RECORDS, PICTURES, SHAPE, REPORT = "records", "pictures", "shape", "report"
CYLINDER, ELASTIC = "cylinder", "elastic-cylinder"
AVERAGE, MEASURED, WORK = "average-diameter", "measured", "virtual-work"
GEOMETRIES = {
    CYLINDER: "cylinder from the braid triangle",
    ELASTIC: "cylinder with elastic threads",
    AVERAGE: "cylinder with the measured average diameter",
    MEASURED: "measured shape",
    WORK: "measured shape, braid force by virtual work",
}
"""Fitted geometries and their descriptions."""
FORCE_MAP = "dataset.csv"
CLOCK = "clock"
"""Source of error: the alignment of the journal's clock with the log's."""
_CLOCK_MAP, _SENSORS, _PRESSURES = "dataset-clock.csv", "sensors.json", "pressures.csv"


def evaluation_steps(
    sheet: Sheet,
    *,
    executor: AnyExecutor | Literal["auto"] = "auto",
    origin: Origin,
    system: str,
) -> list[FolderStep]:
    """Return the steps of a folder in order, without its report.

    Args:
        sheet: sheet of the folder.
        executor: executor for the pictures, see `imaging.process`.
        origin: date and command of the folder's first run, for the files.
        system: unit system of pictures and tables.

    Raises:
        InputError: a file named in the sheet is missing.
    """
    records = sheet.records
    about = {
        "specimen": dict(sheet.entries), "system": system, "errors": dataclasses.asdict(sheet.errors),
    }  # fmt: skip
    inputs = [
        sheet.path(name)
        for name in (records.journal, records.machine_log, records.force_map)
        if name is not None
    ]
    steps = [
        FolderStep(RECORDS, inputs, {**about, **dataclasses.asdict(records)}, (),
             lambda place: _force(sheet, place, system), says=warnings_of),
    ]  # fmt: skip
    names = [CYLINDER, ELASTIC]
    photographs = sheet.photographs
    if photographs is not None:
        recipe, provenance = _recipe(sheet, photographs)
        shown = shown_pictures(sheet, photographs)
        given = {name: value for name, value in provenance.items() if name.endswith("sha256")}
        steps += [
            FolderStep(PICTURES, [*shown, *([] if records.machine_log is None else inputs[1:2])],
                 {"recipe": repr(recipe), **given, **dataclasses.asdict(photographs), **about},
                 (RECORDS,),
                 lambda place: _measure(sheet, photographs, recipe, provenance, executor, place, system),
                 resumes=(PARTS,), says=warnings_of),
            FolderStep(SHAPE, [], about, (PICTURES,), lambda place: _shape(sheet, place)),
        ]  # fmt: skip
        names += [AVERAGE, MEASURED, WORK]
    for name in names:
        after = (RECORDS,) if name in (CYLINDER, ELASTIC) else (RECORDS, SHAPE)
        options = {"fit": dataclasses.asdict(sheet.fit), "turns": sheet.turns, **about}
        steps.append(FolderStep(name, [], options, after, _fitting(sheet, name, origin, system)))
    return steps


def read_map(sheet: Sheet) -> fitting.ForceData:
    """Read the force map written by the first step."""
    return fitting.read_csv(sheet.results / RECORDS / FORCE_MAP, {})


def _force(sheet: Sheet, place: Path, system: str) -> None:
    """Convert journal and log, or a map, to a force map with the specimen in its header."""
    records = sheet.records
    if records.force_map is not None:
        data = fitting.read_csv(
            sheet.path(records.force_map), dataclasses.asdict(sheet.specimen),
            parse_columns(records.columns),
        )  # fmt: skip
        fitting.write_csv(data, place / FORCE_MAP)
        settle(specimen_checks(data.specimen), place)
        return
    assert records.journal is not None
    assert records.machine_log is not None
    journal = read_journal(sheet.path(records.journal))
    named = parse_columns(records.columns)
    named.pop("pressure", None)  # from the journal
    log = read_machine_log(sheet.path(records.machine_log), columns=named)
    analysed = functools.partial(
        analyse, journal, log,
        rest_length=sheet.specimen.rest_length,
        near=None if records.near is None else (records.near, 5.0),
        skip_cycles=records.skip_cycles,
        shortening_positive=records.shortening_positive,
        zero_displacement=records.zero_displacement,
        pushing_positive=records.pushing_positive,
    )  # fmt: skip
    found = analysed()
    apart = dataclasses.replace(
        found.alignment, offset=found.alignment.offset + found.alignment.offset_error
    )
    _write_shared(analysed(alignment=apart), stored_calibration(journal), place)
    machine_time = np.interp(found.record.time, found.alignment.journal_time(log.time), log.time)
    np.savetxt(
        place / _PRESSURES, np.stack([machine_time, found.record.pressure], axis=1),
        fmt="%.10g", delimiter=",", header="time_s,pressure_Pa", comments="",
    )  # fmt: skip
    entries = {k: v for k, v in sheet.entries.items() if not k.startswith("rest_length_")}
    write_dataset(found.characterisation, place / FORCE_MAP, specimen=entries)
    dates = [note["wall"] for note in journal.notes_of("journal")]
    numbers = json.dumps({**figures(found), "dates": dates}, indent=1, allow_nan=False)
    texts = {
        "characterisation.json": numbers + "\n",
        "characterisation.svg": as_svg(plot_characterisation(found, system)),
        "branches.csv": branches_csv(found.characterisation),
    }
    for name, text in texts.items():
        (place / name).write_text(text, encoding="utf-8")
    settle(record_checks(sheet, journal, found), place)


def _recipe(sheet: Sheet, photographs: Photographs) -> tuple[Any, dict[str, str]]:
    """Return the recipe that measures the pictures of a folder, and its provenance."""
    from imaging import Tone
    from imaging.pictures import picture_recipe

    ruler = None if photographs.ruler is None else sheet.path(photographs.ruler)
    given = {
        "pitch": photographs.pitch, "placement_stderr": photographs.ruler_placement,
        "distance": photographs.distance, "tape_diameter": photographs.tape_diameter,
        "k1": photographs.k1, "orientation": photographs.orientation,
        "tone": None if photographs.tone is None else Tone.srgb(),
    }  # fmt: skip
    choices = {name: one for name, one in given.items() if one is not None}
    return picture_recipe(ruler, photographs.scale, choices)


def shown_pictures(sheet: Sheet, photographs: Photographs) -> list[Path]:
    """Return the photographs of a folder, without its ruler."""
    from imaging.pictures import expand

    given = sheet.folder / photographs.pictures
    without = None if photographs.ruler is None else str(sheet.folder / photographs.ruler)
    return [Path(path) for path in expand([str(given)], without=without)]


def _measure(
    sheet: Sheet,
    photographs: Photographs,
    recipe: Any,
    provenance: Mapping[str, str],
    executor: AnyExecutor | Literal["auto"],
    place: Path,
    system: str,
) -> None:
    from imaging.pictures import measure_pictures

    log, added = None, None
    if (path := sheet.records.machine_log) is not None:
        log = read_log_of_pictures(sheet.path(path), columns=parse_columns(sheet.records.columns))
        added = functools.partial(
            _with_log, log, photographs.log_offset, sheet.results / RECORDS / _PRESSURES
        )
    outcome = measure_pictures(
        [str(sheet.folder / photographs.pictures)], recipe=recipe, provenance=dict(provenance),
        add_log=added, rest_length=sheet.specimen.rest_length, executor=executor, system=system,
        output=place,
    )  # fmt: skip
    if not outcome.table.ok.any():
        reasons = "; ".join(sorted({error.partition(":")[0] for error in outcome.table.error}))
        raise InputError(
            f"no picture of {photographs.pictures} could be measured ({reasons}): see "
            f"{place / 'measurements.csv'}, or leave [photographs] out"
        )
    lengths = read_map(sheet).length
    settle(picture_checks(sheet, photographs, outcome.table, log, lengths), place)


def _with_log(log: MachineLog, offset: float | None, path: Path, table: Table) -> Table:
    """Add the log and the journal's pressure at each picture; nan during gaps of the journal.

    Args:
        log: log of the test machine.
        offset: lead of its clock over the first picture [s], if known.
        path: file with pressure over machine time, from the first step.
        table: table of the pictures.
    """
    table = add_log(log, offset)(table)
    if "log_time" not in table.columns or "pressure" in table.columns or not path.exists():
        return table
    pressure = pressure_at(path, table["log_time"])
    return dataclasses.replace(table, columns={**table.columns, "pressure": pressure})


def pressure_at(path: Path, at: np.ndarray) -> np.ndarray:
    """Return the journal's pressure [Pa] at times [s] of the machine's clock; nan where it has a gap."""
    time, pressure = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    after = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    apart = np.minimum(np.abs(at - time[after - 1]), np.abs(at - time[after]))
    known = apart <= 2 * np.median(np.diff(time))
    return np.where(known, np.interp(at, time, pressure), np.nan)


def _shape(sheet: Sheet, place: Path) -> None:
    """Test the measured surface and write its figures as JSON; the fits recompute it in 0.1 s."""
    surface = measured_surface(sheet)
    test, threads = surface.held_out, surface.threads
    content = {
        "form": surface.form._asdict(),
        "pictures": len(surface.used),
        "left_out": list(surface.left_out),
        "held_out": dataclasses.asdict(test),
        "lengths_m": surface.lengths.tolist(),
        "mean_diameter_m": surface.diameters[0].mean(axis=1).tolist(),
        "mean_diameter_std_m": surface.draws[:, 0].mean(axis=2).std(axis=0, ddof=1).tolist(),
        "triangle": dataclasses.asdict(threads),
        "notes": list(surface.summary()),
    }
    (place / "shape.json").write_text(
        json.dumps(content, indent=1, default=float) + "\n", encoding="utf-8"
    )


def measured_surface(sheet: Sheet) -> fitting.shapes.ShapeSurface:
    """Fit the surface through the measured pictures."""
    return fitting.shape_surface(sheet.results / PICTURES / "measurements.nc")


def _fitting(sheet: Sheet, name: str, origin: Origin, system: str) -> Callable[[Path], None]:
    def run(place: Path) -> None:
        data = read_map(sheet)
        surface = None if name in (CYLINDER, ELASTIC) else measured_surface(sheet)
        result = fit_with(sheet, data, name, surface)
        evidence = fitting.evidence.gather(
            result, validation=True, seed=sheet.fit.seed, progress=lambda *_: None,
            shared=_shared(sheet, result.data, name, surface),
        )  # fmt: skip
        write_fit(result, place, system, evidence, origin)
        _add_figures(result, evidence, place)

    return run


def fit_with(
    sheet: Sheet,
    data: fitting.ForceData,
    name: str,
    surface: fitting.shapes.ShapeSurface | None,
) -> fitting.Identification:
    """Identify the law with one of the geometries."""
    fit = sheet.fit
    options: dict[str, Any] = {
        "law": fit.law, "constraint": fit.constraint, "starts": fit.starts, "seed": fit.seed,
    }  # fmt: skip
    if fit.law == "polynomial":
        options["order"] = fit.order
    if name == ELASTIC:
        options["parameters"] = {"braid_compliance": Parameter()}
    if surface is None:
        return fitting.identify(data, **options)
    geometry = _geometry(sheet, sheet.specimen, name, surface)
    if name == WORK:
        options["terms"] = famjax.terms.VirtualWork(0.0)
    if sheet.turns is None and name != WORK:
        least, most = surface.threads.turns_range()
        options["parameters"] = {"turns": Parameter(min=least, max=most)}
    return fitting.identify(_within(data, geometry), geometry=geometry, **options)


def _geometry(
    sheet: Sheet,
    specimen: fitting.Specimen,
    name: str,
    surface: fitting.shapes.ShapeSurface,
    draw: int | None = None,
) -> famjax.geometries.AbstractGeometry:
    """Build a geometry from the measured shape, or from one of its draws."""
    turns = surface.threads.turns if sheet.turns is None else sheet.turns
    braid = famjax.Braid(surface.threads.length, turns, specimen.braid_thickness)
    geometry = surface.geometry(specimen, braid=braid, draw=draw)
    if name == AVERAGE:
        return famjax.measured.AverageDiameterGeometry(geometry.family, geometry.bladder)
    return geometry


def _shared(
    sheet: Sheet,
    data: fitting.ForceData,
    name: str,
    surface: fitting.shapes.ShapeSurface | None,
) -> dict[str, list[Move]]:
    """Collect the errors that the sheet states, and those of clock and shape."""
    records = sheet.results / RECORDS
    errors, clock = _shared_errors(sheet, records), _clock_moves(data, records)
    if surface is None:
        return {**moves_of(data, errors), **clock}
    here = _geometry(sheet, sheet.specimen, name, surface)
    return {
        **moves_of(data, errors, lambda other: _geometry(sheet, other, name, surface)),
        **{
            source: [dataclasses.replace(one, geometry=here) for one in of]
            for source, of in clock.items()
        },
        SHAPE: [
            Move(None, _geometry(sheet, sheet.specimen, name, surface, k)) for k in range(DRAWS)
        ],
    }


def _within(
    data: fitting.ForceData, geometry: famjax.geometries.AbstractGeometry
) -> fitting.ForceData:
    """Return the readings within the lengths of the pictures, with a note on the others."""
    low, high = (float(end) for end in geometry.length_range())
    inside = (data.length >= low) & (data.length <= high)
    if inside.all():
        return data
    if inside.sum() < 8:
        raise InputError(
            f"only {int(inside.sum())} force readings lie within the lengths of the pictures, "
            f"{low * 1e3:.4g} to {high * 1e3:.4g} mm: photographs and force belong to different strokes"
        )
    note = (
        f"{int((~inside).sum())} readings outside the lengths of the pictures, {low * 1e3:.4g} to "
        f"{high * 1e3:.4g} mm, are left out."
    )
    kept = data.part(inside)
    return dataclasses.replace(kept, notes=(*kept.notes, note))


def _add_figures(result: fitting.Identification, evidence: Evidence, place: Path) -> None:
    """Write the figures that the comparison of geometries needs in addition to the fit."""
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
    (place / "figures.json").write_text(
        json.dumps(content, indent=1, allow_nan=True) + "\n", encoding="utf-8"
    )


def _write_shared(clock_moved: Analysis, calibration: Calibration, place: Path) -> None:
    """Write the shared errors that the records determine into the step's folder.

    Args:
        clock_moved: analysis with the clocks shifted by one standard error.
        calibration: calibration of the journal's sensors.
        place: folder of the step.
    """
    write_dataset(clock_moved.characterisation, place / _CLOCK_MAP)
    sensor = calibration.pressure
    known = {
        "pressure_reading": sensor.gain_std / sensor.gain,
        "pressure_zero": sensor.zero_std * sensor.gain,
    }
    text = json.dumps({name: std for name, std in known.items() if math.isfinite(std)}, indent=1)
    (place / _SENSORS).write_text(text + "\n", encoding="utf-8")


def _shared_errors(sheet: Sheet, records: Path) -> SharedErrors:
    """Return the errors of the sheet; the calibration supplies unstated errors of the pressure.

    Args:
        sheet: sheet of the folder.
        records: folder of the records step.
    """
    path = records / _SENSORS
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    stated = sheet.errors.stated()
    return dataclasses.replace(
        sheet.errors, **{name: std for name, std in known.items() if name not in stated}
    )


def _clock_moves(data: fitting.ForceData, records: Path) -> dict[str, list[Move]]:
    """Return the map with the clocks shifted by one standard error; empty without a journal."""
    path = records / _CLOCK_MAP
    if not path.exists():
        return {}
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
    return {CLOCK: [Move(dataclasses.replace(data, **moved))]}
