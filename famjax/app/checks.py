"""Cross-checks: compare values of one quantity from two sources, for records and specimen."""

import dataclasses
import json
import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import sentence_in_units
from fitting.data import Specimen
from fitting.report import PageTable
from rig.journal import Record

from .folder import ASSUMED, Sheet
from .isobaric import Analysis

CHECKS = "checks.json"
"""File with the checks of a step, in its folder."""

AGREES, DOUBTFUL, CONTRADICTS, NOT_KNOWN = "agrees", "doubtful", "contradicts", "not known"

DOUBT, REFUSAL = 2.0, 5.0
"""Standard errors beyond which a value is doubtful, and beyond which the run stops."""

ANY = (-math.inf, math.inf)
"""Range without limits."""
_RATIOS = {
    "inches and mm": 25.4, "inches and cm": 2.54, "cm and mm": 10.0, "m and mm": 1000.0,
    "m and inches": 1 / 0.0254, "feet and inches": 12.0, "lbf and N": 4.4482216152605,
    "kgf and N": 9.80665, "kgf and lbf": 2.20462,
}  # fmt: skip
_LIKE = 0.05  # relative tolerance of a ratio of units
_RATE = 0.02  # relative error of the speed that a machine is set to


@dataclasses.dataclass(frozen=True)
class Check:
    """A comparison, in words.

    Attributes:
        what: compared quantity.
        range: expected range with its unit.
        value: value found with its unit, or "not known".
        verdict: agrees, doubtful, contradicts or not known.
        say: what a disagreement means, and what to do.
    """

    what: str
    range: str
    value: str
    verdict: str
    say: str = ""

    @classmethod
    def of(
        cls,
        what: str,
        found: float,
        expected: tuple[float, float],
        possible: tuple[float, float] = ANY,
        unit: str = "",
        say: str = "",
    ) -> "Check":
        """Compare a value with its expected range, and with the range outside which it is impossible."""
        (low, high), end = expected, f" {unit}".rstrip()
        if math.isnan(found):
            value, verdict = NOT_KNOWN, NOT_KNOWN
        else:
            value, verdict = f"{found:.4g}{end}", AGREES if low <= found <= high else DOUBTFUL
            if not possible[0] <= found <= possible[1]:
                verdict = CONTRADICTS
        told = f"{low:.4g} to {high:.4g}{end}" if math.isfinite(high) else f"{low:.4g}{end} or more"
        return cls(what, "any" if expected == ANY else told, value, verdict, say)

    @classmethod
    def about(
        cls, what: str, found: float, value: float, std: float, *, unit: str = "", say: str = ""
    ) -> "Check":
        """Compare two values by the standard error of their difference."""
        expected, possible = ((value - size * std, value + size * std) for size in (DOUBT, REFUSAL))
        return cls.of(what, found, expected, possible, unit, say)

    def sentence(self) -> str:
        """Describe the check in one or more sentences."""
        known = f"expected {self.range}, found {self.value}"
        return (
            f"{self.what}: {NOT_KNOWN if self.verdict == NOT_KNOWN else known}. {self.say}".strip()
        )


def units_of(ratio: float) -> str:
    """Name the two units with this ratio or its inverse; empty if there are none.

    >>> units_of(0.0394)
    'inches and mm'
    """
    sizes = (
        (names, abs(ratio) / one) for names, known in _RATIOS.items() for one in (known, 1 / known)
    )
    return next((names for names, size in sizes if abs(size - 1) < _LIKE), "")


def settle(checks: Sequence[Check], place: Path) -> None:
    """Write the checks of a step to its folder, and stop on a contradiction.

    Raises:
        InputError: the message names the contradiction and the remedy.
    """
    text = json.dumps([dataclasses.asdict(one) for one in checks], indent=1)
    (place / CHECKS).write_text(text + "\n", encoding="utf-8")
    wrong = [one.sentence() for one in checks if one.verdict == CONTRADICTS]
    if wrong:
        raise InputError(
            f"files in the folder contradict each other. {' '.join(wrong)} All checks are in "
            f"{place / CHECKS}. If an error is known to be larger, state it in [errors] of the sheet"
        )


def read_checks(*places: Path) -> list[Check]:
    """Read the checks of steps; empty if there are none."""
    paths = [place / CHECKS for place in places if (place / CHECKS).exists()]
    return [Check(**row) for path in paths for row in json.loads(path.read_text(encoding="utf-8"))]


def doubts(*places: Path) -> list[str]:
    """Describe each check that is doubtful or could not be made."""
    return [one.sentence() for one in read_checks(*places) if one.verdict != AGREES]


def warnings_of(place: Path) -> list[str]:
    """Format the doubts of one step for printing."""
    return [f"warning: {said}" for said in doubts(place)]


def checks_table(places: Sequence[Path], system: str = "metric") -> list[PageTable]:
    """Build a report table of the checks in a unit system; an empty list without checks."""
    rows = [
        (
            one.what,
            sentence_in_units(one.range, system),
            sentence_in_units(one.value, system),
            one.verdict,
        )
        for one in read_checks(*places)
    ]
    title = "Cross-checks of quantities from two sources. Standard errors set the expected ranges."
    header = ("what", "expected", "found", "verdict")
    return [PageTable(title, header, rows, text=True)] if rows else []


def record_checks(sheet: Sheet, journal: Record, found: Analysis) -> list[Check]:
    """Check the journal, the machine log and the specimen against each other.

    Args:
        sheet: sheet of the folder.
        journal: journal of the test.
        found: analysis of journal and log.
    """
    return [
        *_loads(found, max(sheet.errors.force_reading, ASSUMED.force_reading)),
        *_forces(found, sheet.specimen),
        _rate(journal, found),
        _strokes(journal, found, sheet.records.skip_cycles),
        *specimen_checks(sheet.specimen),
    ]


def specimen_checks(specimen: Specimen) -> list[Check]:
    """Check for impossible sizes, usually a wrong unit, which nothing else in a folder reveals."""
    diameter = specimen.bladder_diameter or specimen.nominal_diameter
    if diameter is None:
        return []
    ranges = {
        "wall_thickness": (0.01, 0.2),
        "rest_length": (2.0, 100.0),
        "braid_thickness": (0.002, 0.1),
    }
    return [
        Check.of(f"{name} over bladder_diameter", getattr(specimen, name) / diameter, expected,
                 say="Check both values in [specimen], and their units: they determine the moduli of the "
                 "bladder.")
        for name, expected in ranges.items() if getattr(specimen, name)
    ]  # fmt: skip


def _loads(found: Analysis, std: float) -> list[Check]:
    """Compare both load cells: a gain may reveal a wrong unit, and scatter a log of another test."""
    loads = found.loads
    units = units_of(loads.gain)
    hint = f", which is the ratio of {units}: correct the unit in the log's header" if units else ""
    return [
        Check.about(
            "ratio of journal load to machine load", loads.gain, 1.0, math.hypot(std, std),
            say=f"They differ by a factor of {loads.gain:.4g}{hint}. The analysis uses the machine's "
            "force: check its unit and both calibrations, and that journal and log belong to one test.",
        ),
        Check.of(
            "remaining scatter of the two loads, relative to their range", loads.scatter,
            (0.0, std / 2), (0.0, 1.5 * std),
            say="Journal and log may belong to two tests, or the log's force column may be another load: "
            "give the log recorded with this journal.",
        ),
    ]  # fmt: skip


def _forces(found: Analysis, specimen: Specimen) -> list[Check]:
    """Check that the force pulls, and that it rises with pressure as a braid's does."""
    bars = found.characterisation.isobars
    pressure, force = np.array([(bar.pressure, bar.force[0]) for bar in bars]).T
    pulls = Check.of(
        "force near the rest length at the highest pressure", float(force[-1]), (0.0, math.inf),
        (0.0, math.inf), "N",
        say="A pressurised muscle pulls. If the machine reports compression as positive, set "
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
            "braid angle from the rise of force with pressure, P pi R^2 (2 tan^2 - 1)", angle,
            (50.0, 80.0), (35.3, 88.0), "deg",
            say="Pressure, force and bladder diameter are inconsistent: check their units, the pressure "
            "calibration, bladder_diameter, and that journal and log belong to one test.",
        ),
    ]  # fmt: skip


def _rate(journal: Record, found: Analysis) -> Check:
    """Compare the machine's speed with the planned rate."""
    what = "ratio of machine speed to planned rate"
    planned = [float(note["rate_m_per_s"]) for note in journal.notes_of("strokes")]
    record = found.record
    held = np.isfinite(record.set_pressure)
    if not planned or held.sum() < 3:
        return Check.of(what, math.nan, (0.95, 1.05), say="The journal has no plan of strokes.")
    speed = np.abs(np.diff(record.length[held]) / np.diff(record.time[held]))
    moving = speed[speed > 0.2 * np.quantile(speed, 0.95)]
    ratio = float(np.median(moving)) / float(np.median(planned)) if moving.size else 0.0
    if units := units_of(ratio):
        say = f"This is the ratio of {units}: correct the unit of the displacement in the log's header."
        return Check.about(what, ratio, 1.0, _RATE, say=say)
    return Check.of(
        what, ratio, (1 - 2 * _RATE, 1 + 2 * _RATE),
        say="The machine ran at another rate than planned, or the unit of its displacement or time is "
        "wrong: check both.",
    )  # fmt: skip


def _strokes(journal: Record, found: Analysis, skipped: int) -> Check:
    """Compare the complete strokes with those that the journal recorded as begun."""
    blocks = defaultdict[int, int](int)
    for note in journal.notes_of("strokes"):
        blocks[int(note["block"])] += int(note["cycles"])
    planned = float(sum(max(cycles - skipped, 0) for cycles in blocks.values()))
    complete = float(sum(bar.cycles for bar in found.characterisation.isobars))
    notes = found.characterisation.notes
    more = f" And {len(notes) - 4} more." if len(notes) > 4 else ""
    return Check.of(
        "complete strokes in journal and log", complete if blocks else math.nan,
        (planned, math.inf),
        say="Strokes are missing, so some pressures have fewer strokes or none. "
        + (" ".join(notes[:4]) + more or "Export the whole log, if it was cut short."),
    )  # fmt: skip
