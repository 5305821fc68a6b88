"""Cross-checks between two sources of one quantity, such as the journal and the machine log."""

import dataclasses
import json
import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from famjax.boundary.errors import InputError
from fitting.data import Specimen
from rig.journal import Record

from .folder import ASSUMED, Sheet
from .isobaric import Analysis

CHECKS = "checks.json"
"""Name of the file with the results of a step's checks, in that step's folder."""

AGREES, DOUBTFUL, CONTRADICTS, NOT_KNOWN = "agrees", "doubtful", "contradicts", "not known"

DOUBT, REFUSAL = 2.0, 5.0
"""Number of standard errors beyond which a value is doubtful, and number beyond which the run stops."""

_RATE = 0.02  # relative error of the speed that a machine is set to


@dataclasses.dataclass(frozen=True)
class Check:
    """The result of a comparison, as text.

    Attributes:
        what: quantity that is compared.
        range: expected range with its unit.
        value: value found with its unit, or "not known".
        verdict: agrees, doubtful, contradicts or not known.
        say: explanation of a disagreement, and what to do about it.
    """

    what: str
    range: str
    value: str
    verdict: str
    say: str

    @classmethod
    def of(
        cls,
        what: str,
        found: float,
        expected: tuple[float, float],
        possible: tuple[float, float] = (-math.inf, math.inf),
        unit: str = "",
        say: str = "",
    ) -> "Check":
        """Compare a value with its expected range, and with the range of possible values."""
        (low, high), end = expected, f" {unit}".rstrip()
        told = f"{low:.4g} to {high:.4g}{end}" if math.isfinite(high) else f"{low:.4g}{end} or more"
        verdict = AGREES if low <= found <= high else DOUBTFUL
        if not possible[0] <= found <= possible[1]:
            verdict = CONTRADICTS
        return cls(what, told, f"{found:.4g}{end}", verdict, "" if verdict == AGREES else say)

    @classmethod
    def about(
        cls, what: str, found: float, value: float, std: float, *, unit: str = "", say: str = ""
    ) -> "Check":
        """Compare two values using the standard error of their difference."""
        expected, possible = ((value - size * std, value + size * std) for size in (DOUBT, REFUSAL))
        return cls.of(what, found, expected, possible, unit, say)

    def sentence(self) -> str:
        """Describe the check in one or more sentences."""
        return f"{self.what}: expected {self.range}, found {self.value}. {self.say}".strip()


def settle(checks: Sequence[Check], place: Path) -> None:
    """Write a step's check results to its folder; raise an error if two sources contradict each other.

    Raises:
        InputError: two sources contradict each other; the message describes how and what to do
        about it.
    """
    text = json.dumps([dataclasses.asdict(one) for one in checks], indent=1)
    (place / CHECKS).write_text(text + "\n", encoding="utf-8")
    wrong = [one.sentence() for one in checks if one.verdict == CONTRADICTS]
    if wrong:
        raise InputError(
            f"files in the folder contradict each other. {' '.join(wrong)} All checks are listed in "
            f"{place / CHECKS}. If you know that a measurement is less accurate, enter its standard error "
            "under [errors] in the sheet"
        )


def read_checks(*places: Path) -> list[Check]:
    """Read the checks from the folders of the given steps; return [] if there are none."""
    paths = [place / CHECKS for place in places if (place / CHECKS).exists()]
    return [Check(**row) for path in paths for row in json.loads(path.read_text(encoding="utf-8"))]


def record_checks(sheet: Sheet, journal: Record, found: Analysis) -> list[Check]:
    """Check the journal, the machine log and the specimen against each other.

    Args:
        sheet: sheet in the folder.
        journal: journal of the test.
        found: analysis of the journal and the log.
    """
    std = max(sheet.errors.force_reading, ASSUMED.force_reading)
    plan = _plan(journal, found, sheet.records.skip_cycles)
    return [*_loads(found, std), *_angle(found, sheet.specimen), *plan]


def _loads(found: Analysis, std: float) -> list[Check]:
    """Compare the load cells. The gain may reveal a wrong unit, and the scatter a log from another test."""
    gain, scatter = found.loads
    return [
        Check.about(
            "ratio of journal load to machine load", gain, 1.0, math.hypot(std, std),
            say=f"The loads differ by a factor of {gain:.4g}. A factor of 4.448 means that lbf and N were "
            "confused; 9.807, kgf and N; 1000, kN and N. The analysis uses the machine's force: check its "
            "unit and both calibrations, and check that the journal and the log are from the same test.",
        ),
        Check.of(
            "residual scatter between the two loads, relative to their range", scatter,
            (0.0, std / 2), (0.0, 1.5 * std),
            say="The journal and the log may be from different tests, or the force column in the log may "
            "contain a different load: use the log that was recorded with this journal.",
        ),
    ]  # fmt: skip


def _angle(found: Analysis, specimen: Specimen) -> list[Check]:
    """Check that the force rises with pressure as it should for a braid."""
    bars = found.characterisation.isobars
    pressure, force = np.array([(bar.pressure, bar.force[0]) for bar in bars]).T
    diameter = specimen.bladder_diameter or specimen.nominal_diameter
    if len(bars) < 2 or diameter is None:
        return []
    slope = float(np.polyfit(pressure, force, 1)[0])
    area = math.pi / 4 * (diameter + 2 * specimen.braid_thickness) ** 2
    angle = math.degrees(math.atan(math.sqrt(max((slope / area + 1) / 2, 0.0))))
    return [
        Check.of(
            "braid angle calculated from the rise of force with pressure, P pi R^2 (2 tan^2 - 1)", angle,
            (50.0, 80.0), (35.3, 88.0), "deg",
            say="The pressure, force and bladder diameter are inconsistent: check their units, the sign of "
            "the force, the pressure calibration and bladder_diameter, and check that the journal and the "
            "log are from the same test.",
        ),
    ]  # fmt: skip


def _plan(journal: Record, found: Analysis, skipped: int) -> list[Check]:
    """Compare the speed and the number of strokes with the plan in the journal."""
    blocks, rates = defaultdict[int, int](int), []
    for note in journal.notes_of("strokes"):
        blocks[int(note["block"])] += int(note["cycles"])
        rates.append(float(note["rate_m_per_s"]))
    if not rates:
        return []
    planned = float(sum(max(cycles - skipped, 0) for cycles in blocks.values()))
    curves, record = found.characterisation, found.record
    complete = float(sum(bar.cycles for bar in curves.isobars))
    held = np.isfinite(record.set_pressure)
    speed = np.abs(np.diff(record.length[held]) / np.diff(record.time[held]))
    ratio = float(np.median(speed[speed > 0.2 * np.quantile(speed, 0.95)]) / np.median(rates))
    return [
        Check.of(
            "ratio of machine speed to planned rate", ratio, (1 - 2 * _RATE, 1 + 2 * _RATE),
            (0.4, 2.5),
            say="The machine did not run at the planned rate, or the unit of its displacement or time is "
            "wrong: check both. A factor of 25.4 means that inches and mm were confused; 1000, m and mm or "
            "mm and um.",
        ),
        Check.of(
            "complete strokes in journal and log", complete, (planned, math.inf),
            say="Strokes are missing, so some pressures have fewer strokes than planned, or none. "
            + (" ".join(curves.notes[:4]) or "If the log was cut short, export the whole log."),
        ),
    ]  # fmt: skip
