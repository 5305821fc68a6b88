"""Cross-checks: what two sources say of one thing, what was expected of it, and whether that holds."""

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from famjax.boundary.errors import InputError
from famjax.boundary.sentence import text_in_units
from fitting.saved import PageTable

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


@dataclasses.dataclass(frozen=True)
class Check:
    """A figure, and what it must be.

    Attributes:
        what: it is.
        found: value; nan where it could not be found.
        expected: range outside which it is doubtful.
        possible: range outside which the work stops.
        unit: of all of them.
        say: what may be wrong where it is not as expected, and what to do.
    """

    what: str
    found: float
    expected: tuple[float, float]
    possible: tuple[float, float] = _ANYTHING
    unit: str = ""
    say: str = ""

    @classmethod
    def about(
        cls, what: str, found: float, value: float, std: float, *, unit: str = "", say: str = ""
    ) -> "Check":
        """A figure that must be near a value, as near as its standard error says."""
        expected, possible = ((value - size * std, value + size * std) for size in (DOUBT, REFUSAL))
        return cls(what, found, expected, possible, unit, say)

    @property
    def verdict(self) -> Verdict:
        """What comes of it."""
        if math.isnan(self.found):
            return NOT_KNOWN
        if not self.possible[0] <= self.found <= self.possible[1]:
            return CONTRADICTS
        return AGREES if self.expected[0] <= self.found <= self.expected[1] else DOUBTFUL

    @property
    def range(self) -> str:
        """What was expected, in words."""
        low, high = self.expected
        if math.isinf(low) and math.isinf(high):
            return "any"
        if math.isinf(high):
            return f"{low:.4g} or more{self._unit}"
        return f"{low:.4g} to {high:.4g}{self._unit}"

    @property
    def value(self) -> str:
        """What was found, in words."""
        return NOT_KNOWN if math.isnan(self.found) else f"{self.found:.4g}{self._unit}"

    def sentence(self) -> str:
        """What must hold, what was found, what to do."""
        found = NOT_KNOWN
        if not math.isnan(self.found):
            found = f"expected {self.range}, found {self.value}"
        return f"{self.what}: {found}. {self.say}".strip()

    @property
    def _unit(self) -> str:
        return f" {self.unit}" if self.unit else ""


def units_of(ratio: float) -> str:
    """The two units whose ratio this is, or its inverse; empty where there are none.

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
    """Write the checks of a step into its folder, and stop where one contradicts.

    Raises:
        InputError: what contradicts, and what to do.
    """
    rows = [{**dataclasses.asdict(one), "verdict": one.verdict} for one in checks]
    text = json.dumps(_finite(rows), indent=1, allow_nan=False)
    (place / CHECKS).write_text(text + "\n", encoding="utf-8")
    wrong = [one for one in checks if one.verdict == CONTRADICTS]
    if wrong:
        raise InputError(
            f"what lies in the folder contradicts itself. {' '.join(one.sentence() for one in wrong)} "
            f"All that was compared is in {place / CHECKS}; where an error is known to be larger, "
            "state it in [errors] of the sheet"
        )


def read_checks(place: Path) -> list[Check]:
    """The checks of a step, none where it made none."""
    path = place / CHECKS
    if not path.exists():
        return []
    found = []
    for row in json.loads(path.read_text(encoding="utf-8")):
        low, high = row["expected"], row["possible"]
        found.append(
            Check(row["what"], _number(row["found"], math.nan), _pair(low), _pair(high),
                  row["unit"], row["say"])
        )  # fmt: skip
    return found


def doubts(places: Sequence[Path]) -> list[str]:
    """A sentence for each check of several steps that is doubtful or could not be made."""
    checks = [one for place in places for one in read_checks(place)]
    return [one.sentence() for one in checks if one.verdict != AGREES]


def warnings_of(place: Path) -> list[str]:
    """The same of one step, as they are printed."""
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


def _finite(value: Any) -> Any:
    """For JSON: None for what is not finite."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    return [_finite(one) for one in value] if isinstance(value, list | tuple) else value


def _number(value: float | None, nothing: float) -> float:
    return nothing if value is None else value


def _pair(value: Sequence[float | None]) -> tuple[float, float]:
    return _number(value[0], -math.inf), _number(value[1], math.inf)
