"""Cross-checks: whether two sources agree on one quantity; for records and specimen."""

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import text_in_units
from fitting.data import Specimen
from fitting.report import PageTable
from rig.journal import Record

from .folder import ASSUMED, Sheet
from .isobaric import Analysis

CHECKS = "checks.json"
"""In the folder of a step: what was checked."""

AGREES, DOUBTFUL, CONTRADICTS, NOT_KNOWN = "agrees", "doubtful", "contradicts", "not known"
Verdict = Literal["agrees", "doubtful", "contradicts", "not known"]

DOUBT, REFUSAL = 2.0, 5.0
"""Standard errors beyond which a figure is doubtful, and beyond which the work stops."""

_ANYTHING = (-math.inf, math.inf)
_RATIOS = {
    "inches and mm": 25.4, "inches and cm": 2.54, "cm and mm": 10.0, "m and mm": 1000.0,
    "m and inches": 1 / 0.0254, "feet and inches": 12.0, "lbf and N": 4.4482216152605,
    "kgf and N": 9.80665, "kgf and lbf": 2.20462,
}  # fmt: skip
_LIKE = 0.05  # relative, by which a ratio of units may be missed
_RATE = 0.02  # relative, of a machine's rate as it was set


@dataclasses.dataclass(frozen=True)
class Check:
    """What was compared, as it is told.

    Attributes:
        what: was found, in words.
        range: that was expected, with its unit.
        value: that was found, or that it is not known.
        verdict: where the value lies.
        say: what it means where it does not agree, and what to do.
    """

    what: str
    range: str
    value: str
    verdict: Verdict
    say: str = ""

    @classmethod
    def of(
        cls,
        what: str,
        found: float,
        expected: tuple[float, float],
        possible: tuple[float, float] = _ANYTHING,
        unit: str = "",
        say: str = "",
    ) -> "Check":
        """A figure against the range in which it is expected, and that beyond which it cannot be."""
        (low, high), end = expected, f" {unit}".rstrip()
        verdict: Verdict = NOT_KNOWN
        if not math.isnan(found):
            agrees = low <= found <= high
            verdict = AGREES if agrees else DOUBTFUL
            if not possible[0] <= found <= possible[1]:
                verdict = CONTRADICTS
        told = f"{low:.4g} to {high:.4g}{end}" if math.isfinite(high) else f"{low:.4g}{end} or more"
        value = NOT_KNOWN if math.isnan(found) else f"{found:.4g}{end}"
        return cls(what, "any" if expected == _ANYTHING else told, value, verdict, say)

    @classmethod
    def about(
        cls, what: str, found: float, value: float, std: float, *, unit: str = "", say: str = ""
    ) -> "Check":
        """A figure that must agree with another within the standard error of their difference."""
        expected, possible = ((value - size * std, value + size * std) for size in (DOUBT, REFUSAL))
        return cls.of(what, found, expected, possible, unit, say)

    def sentence(self) -> str:
        """The check as it is told."""
        known = f"expected {self.range}, found {self.value}"
        return (
            f"{self.what}: {NOT_KNOWN if self.verdict == NOT_KNOWN else known}. {self.say}".strip()
        )


def units_of(ratio: float) -> str:
    """The two units whose ratio is this value or its inverse; empty if there are none.

    >>> units_of(0.0394)
    'inches and mm'
    """
    size = abs(ratio)
    for names, known in _RATIOS.items():
        for one in (known, 1 / known):
            if abs(size / one - 1) < _LIKE:
                return names
    return ""


def settle(checks: Sequence[Check], place: Path) -> None:
    """Write the checks of a step into its folder, and stop if one contradicts.

    Raises:
        InputError: what contradicts, and what to do.
    """
    text = json.dumps([dataclasses.asdict(one) for one in checks], indent=1)
    (place / CHECKS).write_text(text + "\n", encoding="utf-8")
    wrong = [one for one in checks if one.verdict == CONTRADICTS]
    if wrong:
        raise InputError(
            f"what lies in the folder contradicts itself. {' '.join(one.sentence() for one in wrong)} "
            f"All that was compared is in {place / CHECKS}; where an error is known to be larger, "
            "state it in [errors] of the sheet"
        )


def read_checks(place: Path) -> list[Check]:
    """Read the checks of a step; empty if it made none."""
    path = place / CHECKS
    rows = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    return [Check(**row) for row in rows]


def doubts(places: Sequence[Path]) -> list[str]:
    """A sentence for each check of several steps that is doubtful or could not be made."""
    checks = [one for place in places for one in read_checks(place)]
    return [one.sentence() for one in checks if one.verdict != AGREES]


def warnings_of(place: Path) -> list[str]:
    """The doubts of one step, as they are printed."""
    return [f"warning: {said}" for said in doubts([place])]


def checks_table(places: Sequence[Path], system: str = "metric") -> list[PageTable]:
    """The checks of several steps as a table of the report, in a unit system; none without checks."""
    checks = [one for place in places for one in read_checks(place)]
    rows = [
        (one.what, text_in_units(one.range, system), text_in_units(one.value, system), one.verdict)
        for one in checks
    ]
    title = "What two sources say of one thing, and what it must be by their standard errors."
    header = ("what", "expected", "found", "verdict")
    return [PageTable(title, header, rows, text=True)] if rows else []


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
        _strokes(journal, found, sheet.records.skip_cycles),
        *specimen_checks(sheet.specimen),
    ]


def specimen_checks(specimen: Specimen) -> list[Check]:
    """Check for sizes that no muscle has, usually a wrong unit, which nothing else in a folder reveals."""
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
        Check.of(what, value, expected, say="Check both in [specimen], and their units: the moduli of "
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
        Check.of(
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
    pulls = Check.of(
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
        Check.of(
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
        return Check.of(what, math.nan, (0.95, 1.05), say="The journal has no plan of strokes.")
    speed = np.abs(np.diff(record.length[held]) / np.diff(record.time[held]))
    moving = speed[speed > 0.2 * np.quantile(speed, 0.95)]
    ratio = float(np.median(moving)) / float(np.median(planned)) if moving.size else 0.0
    units = units_of(ratio)
    if not units:
        return Check.of(
            what, ratio, (1 - 2 * _RATE, 1 + 2 * _RATE),
            say="The machine was set to another rate than the plan's, or the unit of its "
            "displacement or time is wrong: check both.",
        )  # fmt: skip
    return Check.about(
        what, ratio, 1.0, _RATE,
        say=f"This is the ratio of {units}: correct the unit of the displacement in the log's header.",
    )  # fmt: skip


def _strokes(journal: Record, found: Analysis, skipped: int) -> Check:
    """Complete strokes at each pressure against what the journal says was begun."""
    begun = journal.notes_of("strokes")
    blocks: dict[float, int] = {}
    for note in begun:
        number = int(note["block"])
        blocks[number] = blocks.get(number, 0) + int(note["cycles"])
    planned = float(sum(max(cycles - skipped, 0) for cycles in blocks.values()))
    complete = float(sum(bar.cycles for bar in found.characterisation.isobars))
    return Check.of(
        "complete strokes in journal and log", complete if begun else math.nan,
        (planned, math.inf),
        say="Strokes are missing, so that their pressures rest on fewer of them or none: "
        + (_listed(found.characterisation.notes) or "export the whole log, if it was cut short."),
    )  # fmt: skip


def _listed(notes: Sequence[str]) -> str:
    return " ".join(notes[:4]) + (f" And {len(notes) - 4} more." if len(notes) > 4 else "")
