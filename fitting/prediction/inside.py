"""What a saved fit covers, and why a state lies beyond it."""

import dataclasses

import numpy as np

import famjax
from famjax.boundary.sentence import Quantity, Sentence

from ..saved.saved_fit import SavedFit

_FARTHEST = 3.4
"""Times as long, of the muscles with which predictions from one specimen were tried: 83 and 281 mm."""


@dataclasses.dataclass(frozen=True)
class Reach:
    """What the fitted data cover.

    Attributes:
        rest_length: of the muscle that is asked for [m].
        ratios: lowest and highest length in parts of the rest length.
        pressures: lowest and highest gauge pressure [Pa].
        rest_lengths: shortest and longest of the specimens of the fit [m]; of one specimen, those
            that are not too far from its own.
        whose: what they are, in words.
        thread_length: active length [m] at which the unloaded threads are straight, nan without
            a braid.
        lock: active length [m] at the neutral angle, nan without a braid.
    """

    rest_length: float
    ratios: tuple[float, float]
    pressures: tuple[float, float]
    rest_lengths: tuple[float, float]
    whose: str
    thread_length: float
    lock: float

    def leaves(self, length: float, pressure: float, answer: float | None) -> str | None:
        """Why a state is beyond what was fitted, the gravest reason; None where it is not.

        Args:
            length: active length [m].
            pressure: gauge pressure [Pa].
            answer: the force or onset there, None where there is none.
        """
        low, high = (ratio * self.rest_length for ratio in self.ratios)
        shortest, longest = self.rest_lengths
        lowest, highest = self.pressures
        rounding, none = 1e-12 * self.rest_length, answer is None
        reasons = (
            (none and length >= self.thread_length,
             Sentence("the length is beyond the thread's, ", _of(self.thread_length))),
            (length < self.lock,
             Sentence("the length is below the braid's lock at the neutral angle, ", _of(self.lock))),
            (not low - rounding <= length <= high + rounding,
             Sentence("the length is beyond the measured ", _of(low), " to ", _of(high))),
            (not shortest <= self.rest_length <= longest,
             Sentence(
                 f"the rest length is beyond {self.whose} ", _of(shortest), " to ", _of(longest))),
            (none, "there the muscle has neither a force nor an onset"),
            (not lowest <= pressure <= highest,
             Sentence(
                 "the pressure is beyond the measured ", _of(lowest, "pressure"), " to ",
                 _of(highest, "pressure"))),
        )  # fmt: skip
        return next((reason for holds, reason in reasons if holds), None)


def _of(value: float, kind: str = "length") -> Quantity:
    return Quantity(value, kind)


def reach_of(fit: SavedFit, rest_length: float | None) -> Reach:
    """What a saved fit covers.

    Args:
        fit: from `load_fit`.
        rest_length: L0 [m] of another muscle of the same series, None for the fitted one.
    """
    readings, fitted = fit.document["data"]["readings"], float(fit.muscle.geometry.rest_length)
    series = fit.document.get("series")
    asked = fitted if rest_length is None else rest_length
    if series is not None:
        ratios, pressures = series["length_ratios"], series["pressures_Pa"]
        rest, whose = series["rest_lengths_m"], "the specimens'"
    else:
        ratios, pressures = np.array(readings["length_m"]) / fitted, readings["pressure_Pa"]
        rest = (fitted / _FARTHEST, fitted * _FARTHEST)
        whose = f"{_FARTHEST:g} times the specimen's either way, as far as was tried:"
    muscle = fit.muscle if rest_length is None else famjax.cut_to_length(fit.muscle, rest_length)
    lock, thread = (float(at) for at in muscle.geometry.braid_limits())
    return Reach(
        rest_length=asked,
        ratios=(min(ratios), max(ratios)),
        pressures=(min(pressures), max(pressures)),
        rest_lengths=(min(rest), max(rest)),
        whose=whose,
        thread_length=thread,
        lock=lock,
    )
