"""What a search of designs keeps to, what it varies and what it looks for."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

from ...boundary.errors import InputError

ATMOSPHERE = 101325.0
"""Standard atmosphere [Pa], at which free air is counted."""

COLUMNS: dict[str, str] = {
    "rest_length": "length",
    "pressure": "pressure",
    "braid_angle": "angle",
    "nominal_diameter": "length",
    "blocked_force": "force",
    "force": "force",
    "contraction": "number",
    "stroke": "length",
    "outer_diameter": "length",
    "air": "volume",
    "burst_factor": "number",
    "pull_factor": "number",
    "thread_factor": "number",
    "tube_factor": "number",
}
"""The numbers of a candidate, in SI, and the kind of unit of each; see `SpaceSearch`."""

OBJECTIVES: dict[str, Literal["least", "most"]] = {
    "outer_diameter": "least",
    "rest_length": "least",
    "pressure": "least",
    "air": "least",
    "force": "most",
    "blocked_force": "most",
    "contraction": "most",
    "stroke": "most",
}
"""What a front can weigh, and which of it is better."""

DEFAULT_OBJECTIVES = ("outer_diameter", "rest_length", "air")
"""The room that a muscle takes, and the air that a stroke costs."""

BALANCED = "balanced"
"""The goal of a refinement that is all objectives at once; the others are the objectives."""

CONSTRAINTS: dict[str, tuple[str, Literal["least", "most"]]] = {
    "force": ("force", "least"),
    "contraction": ("contraction", "least"),
    "stroke": ("stroke", "least"),
    "largest_diameter": ("outer_diameter", "most"),
    "longest_length": ("rest_length", "most"),
    "burst_factor": ("burst_factor", "least"),
    "pull_factor": ("pull_factor", "least"),
    "thread_factor": ("thread_factor", "least"),
    "tube_factor": ("tube_factor", "least"),
}
"""What is asked for: the column that it is held against, and whether as a lower or an upper limit."""

FACTORS = ("burst_factor", "pull_factor", "thread_factor", "tube_factor")
"""Safety factors: known of some pairs only, and asked for where they are above zero."""


@dataclasses.dataclass(frozen=True)
class SearchLimits:
    """What a design keeps to beside its `Requirement`. Zero and infinity ask for nothing.

    Attributes:
        stroke: travel [m] it must reach, >= 0.
        force_stroke: travel [m] at which the requirement's force is asked for, >= 0, where that is
            further than its `force_contraction`.
        longest_length: space [m] between the end-fittings: the rest length is not to exceed it.
        burst_factor: least burst pressure over pressure [-].
        pull_factor: least pull that broke a tested muscle over the blocked force [-].
        thread_factor: least breaking load of a thread over its tension at zero contraction [-].
        tube_factor: least yield load of the swage tube's section over the blocked force [-], as if
            the tube carried all of it.
        end_fittings: whether a swage tube of the catalogue must fit the pair, as
            `size_end_fittings` has it; of those that fit, the one that yields last is taken.
        bore_stretch: by how much [-] the inner fitting may stretch the bladder's bore.
    """

    stroke: float = 0.0
    force_stroke: float = 0.0
    longest_length: float = math.inf
    burst_factor: float = 0.0
    pull_factor: float = 0.0
    thread_factor: float = 0.0
    tube_factor: float = 0.0
    end_fittings: bool = True
    bore_stretch: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what no muscle could be asked for."""
        for name in ("stroke", "force_stroke", *FACTORS, "bore_stretch"):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise InputError(f"{name} must be >= 0 and finite, got {value}")
        if not self.longest_length > 0:
            raise InputError(f"longest_length must be > 0, got {self.longest_length} m")
        if self.tube_factor > 0 and not self.end_fittings:
            raise InputError("a tube_factor needs the end-fittings: ask for both or for neither")


@dataclasses.dataclass(frozen=True)
class SearchRanges:
    """What is varied, evenly from the first to the last number; two equal ones keep it fixed.

    Attributes:
        rest_length: active length L0 [m] at rest.
        pressure: gauge pressure P [Pa]; at most that of the requirement.
    """

    rest_length: tuple[float, float]
    pressure: tuple[float, float]

    def __post_init__(self) -> None:
        """Refuse ranges that are empty or hold what cannot be."""
        for name, unit in (("rest_length", "m"), ("pressure", "Pa")):
            least, greatest = getattr(self, name)
            if not 0 < least <= greatest < math.inf:
                raise InputError(
                    f"the range of the {name} must be two numbers, 0 < least <= greatest, got "
                    f"{least:.6g} to {greatest:.6g} {unit}"
                )


def check_objectives(objectives: Sequence[str]) -> tuple[str, ...]:
    """The objectives, if they are known and each is named once.

    Raises:
        InputError: none, an unknown one, or one that is there twice.
    """
    given = tuple(objectives)
    unknown = [name for name in given if name not in OBJECTIVES]
    if unknown or not given or len(set(given)) < len(given):
        raise InputError(
            f"objectives must be one or more of {', '.join(OBJECTIVES)}, each once; got "
            f"{', '.join(map(repr, given)) or 'none'}"
        )
    return given
