"""Whether the records of a test and the specimen agree: loads, motion, pressures, sizes."""

import math
from collections.abc import Sequence

import numpy as np

from fitting.data import Specimen
from rig.journal import Record

from ..isobaric_analysis import Analysis
from .cross_checks import Check, units_of
from .sheet import ASSUMED, Sheet

_MOST = 1 - 1 / math.sqrt(3)
"""No muscle whose threads keep their length contracts more: at most from straight threads to the
neutral angle."""
_RATE = 0.02  # relative, of a machine's rate as it was set


def record_checks(sheet: Sheet, journal: Record, found: Analysis) -> list[Check]:
    """The checks of journal, machine's log and specimen.

    Args:
        sheet: of the folder.
        journal: as read.
        found: from it and the log.
    """
    return [
        *_loads(found, max(sheet.errors.force_reading, ASSUMED.force_reading)),
        *_forces(found, sheet.specimen),
        _rate(journal, found),
        _contraction(found),
        _pressures(found),
        _strokes(journal, found, sheet.records.skip_cycles),
        *specimen_checks(sheet.specimen),
    ]


def specimen_checks(specimen: Specimen) -> list[Check]:
    """Sizes that no muscle has: mostly a wrong unit. Nothing else in a folder tells them."""
    diameter = specimen.bladder_diameter or specimen.nominal_diameter
    if diameter is None:
        return []
    sizes = [
        ("wall_thickness over bladder_diameter", specimen.wall_thickness / diameter, (0.01, 0.2)),
        ("rest_length over bladder_diameter", specimen.rest_length / diameter, (2.0, 100.0)),
    ]
    if specimen.braid_thickness:
        ratio = specimen.braid_thickness / diameter
        sizes.append(("braid_thickness over bladder_diameter", ratio, (0.002, 0.1)))
    return [
        Check(what, value, expected, say="Check both in [specimen], and their units: the moduli of "
              "the bladder follow from them.")
        for what, value, expected in sizes
    ]  # fmt: skip


def _loads(found: Analysis, std: float) -> list[Check]:
    """Both load cells: a gain that is a ratio of units, and a scatter that is not of one test."""
    loads = found.loads
    units = units_of(loads.gain)
    hint = f", which is the ratio of {units}: correct the unit in the log's header" if units else ""
    return [
        Check.about(
            "load of the journal over load of the machine", loads.gain, 1.0,
            math.hypot(std, std),
            say=f"They differ by a factor of {loads.gain:.4g}{hint}. The force is the machine's: check "
            "its unit, its calibration and that of the rig's load cell, and whether journal and log "
            "are of one test.",
        ),
        Check(
            "what the loads differ by after that, of their range", loads.scatter,
            (0.0, std / 2), (0.0, 1.5 * std),
            say="Journal and log may be of two tests, or a column of the log is another load: give "
            "the log that was recorded with this journal.",
        ),
    ]  # fmt: skip


def _forces(found: Analysis, specimen: Specimen) -> list[Check]:
    """The force pulls, and rises with the pressure as that of a braid."""
    bars = found.characterisation.isobars
    pressure = np.array([bar.pressure for bar in bars])
    force = np.array([bar.force[0] for bar in bars])
    pulls = Check(
        "force near the rest length at the highest pressure", float(force[-1]), (0.0, math.inf),
        (0.0, math.inf), "N",
        say="A muscle under pressure pulls: where the machine counts compression as positive, set "
        "pushing_positive = true in [records].",
    )  # fmt: skip
    diameter = specimen.bladder_diameter or specimen.nominal_diameter
    if len(bars) < 2 or diameter is None:
        return [pulls]
    slope = float(np.polyfit(pressure, force, 1)[0])
    area = math.pi / 4 * (diameter + 2 * specimen.braid_thickness) ** 2
    angle = math.degrees(math.atan(math.sqrt(max((slope / area + 1) / 2, 0.0))))
    return [
        pulls,
        Check(
            "braid angle by which the force rises with the pressure, P pi R^2 (2 tan^2 - 1)", angle,
            (50.0, 80.0), (35.3, 88.0), "deg",
            say="Pressures, forces and the bladder's diameter do not fit together: check the units "
            "and the calibration of the pressure, bladder_diameter, and whether journal and log are "
            "of one test.",
        ),
    ]  # fmt: skip


def _rate(journal: Record, found: Analysis) -> Check:
    """The machine's speed against what the plan asks for."""
    what = "speed of the machine over the rate of the plan"
    planned = [float(note["rate_m_per_s"]) for note in journal.notes_of("strokes")]
    record = found.record
    held = np.isfinite(record.set_pressure)
    if not planned or held.sum() < 3:
        return Check(what, math.nan, (0.95, 1.05), say="The journal has no plan of strokes.")
    speed = np.abs(np.diff(record.length[held]) / np.diff(record.time[held]))
    moving = speed[speed > 0.2 * np.quantile(speed, 0.95)]
    ratio = float(np.median(moving)) / float(np.median(planned)) if moving.size else 0.0
    units = units_of(ratio)
    if not units:
        return Check(
            what, ratio, (1 - 2 * _RATE, 1 + 2 * _RATE),
            say="The machine was set to another rate than the plan's, or the unit of its "
            "displacement or time is wrong: check both.",
        )  # fmt: skip
    return Check.about(
        what, ratio, 1.0, _RATE,
        say=f"This is the ratio of {units}: correct the unit of the displacement in the log's header.",
    )  # fmt: skip


def _contraction(found: Analysis) -> Check:
    """The largest contraction at which the muscle still pulls."""
    most = 0.0
    for bar in found.characterisation.isobars:
        pulling = bar.length[bar.force > 0.02 * abs(bar.force[0])]
        if pulling.size:
            most = max(most, 1 - float(pulling.min()) / found.record.rest_length)
    return Check(
        "largest contraction at which the muscle pulls", most, (0.03, 0.40), (0.0, _MOST),
        say="No braid contracts by more than 0.423 of its rest length, and a stroke is mostly more "
        "than 0.03 of it: check rest_length and zero_displacement in the sheet, and the unit of the "
        "log's displacement.",
    )  # fmt: skip


def _pressures(found: Analysis) -> Check:
    """The pressure that was held against the one set."""
    off = max(
        abs(bar.pressure / bar.set_pressure - 1) if bar.set_pressure else 0.0
        for bar in found.characterisation.isobars
    )
    return Check(
        "mean pressure held against the set one, largest difference",
        off,
        (0.0, 0.05),
        (0.0, 0.5),
        say="The pressure was not held: look for a leak or an exhausted supply, and repeat the test.",
    )


def _strokes(journal: Record, found: Analysis, skipped: int) -> Check:
    """Complete strokes at each pressure against what the journal says was begun."""
    begun = journal.notes_of("strokes")
    blocks: dict[float, int] = {}
    for note in begun:
        number = int(note["block"])
        blocks[number] = blocks.get(number, 0) + int(note["cycles"])
    planned = float(sum(max(cycles - skipped, 0) for cycles in blocks.values()))
    complete = float(sum(bar.cycles for bar in found.characterisation.isobars))
    return Check(
        "complete strokes in journal and log", complete if begun else math.nan,
        (planned, math.inf),
        say="Strokes are missing, so that their pressures rest on fewer of them or none: "
        + (_listed(found.characterisation.notes) or "export the whole log, if it was cut short."),
    )  # fmt: skip


def _listed(notes: Sequence[str]) -> str:
    return " ".join(notes[:4]) + (f" And {len(notes) - 4} more." if len(notes) > 4 else "")
