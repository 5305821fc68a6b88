"""What a saved fit covers, why a state lies beyond it, and beyond what nothing is said."""

import dataclasses
import functools

import numpy as np

import famjax
from famjax.boundary.sentence import Quantity, Sentence

from ..saved.saved_fit import SavedFit

_FARTHEST = 3.4
"""Times as long, of the muscles with which predictions from one specimen were tried: 83 and 281 mm."""

_MOST = 10.0
"""Times the largest measured force: a law that gives more beyond the measured lengths has left its data."""


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
        geometry: of the muscle that is asked for.
        largest_force: measured [N].
    """

    rest_length: float
    ratios: tuple[float, float]
    pressures: tuple[float, float]
    rest_lengths: tuple[float, float]
    whose: str
    thread_length: float
    lock: float
    geometry: famjax.geometries.AbstractGeometry
    largest_force: float

    @functools.cached_property
    def closed(self) -> float:
        """Active length [m] at which the braid closes the bladder's bore: the geometry's longest."""
        return float(self.geometry.length_range()[1])

    def refuses(self, length: float, model_force: float) -> str | None:
        """Why nothing is said of a state, although the model has a force; None where something is.

        Beyond the braid's limits the geometry is that of no muscle, and a law that is asked far from
        its strains may give anything. At the measured lengths there is always an answer.

        Args:
            length: active length [m].
            model_force: there [N], not clipped; nan where the model has none.
        """
        low, high = self._measured
        if not np.isfinite(model_force) or low <= length <= high:
            return None
        if length < self.lock:
            return self._below_lock
        if length > high and length > self.closed:
            return Sentence(
                "the length is beyond that at which the braid closes the bladder's bore, ",
                _of(self.closed),
            )
        if model_force > _MOST * self.largest_force:
            return Sentence(
                "the length is so far beyond the measured ", _of(low), " to ", _of(high),
                " that the model's force, ", _of(model_force, "force"), f", is over {_MOST:g} times "
                "the largest measured",
            )  # fmt: skip
        return None

    @property
    def _measured(self) -> tuple[float, float]:
        """Shortest and longest active length [m] of the data, rounding aside."""
        rounding = 1e-12 * self.rest_length
        low, high = (ratio * self.rest_length for ratio in self.ratios)
        return low - rounding, high + rounding

    @property
    def _below_lock(self) -> Sentence:
        return Sentence(
            "the length is below the braid's lock at the neutral angle, ", _of(self.lock)
        )

    def leaves(self, length: float, pressure: float, answer: float | None) -> str | None:
        """Why a state is beyond what was fitted, the gravest reason; None where it is not.

        Args:
            length: active length [m].
            pressure: gauge pressure [Pa].
            answer: the force or onset there, None where there is none.
        """
        low, high = self._measured
        shortest, longest = self.rest_lengths
        lowest, highest = self.pressures
        none = answer is None
        reasons = (
            (none and length >= self.thread_length,
             Sentence("the length is beyond the thread's, ", _of(self.thread_length))),
            (length < self.lock, self._below_lock),
            (not low <= length <= high,
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
        geometry=muscle.geometry,
        largest_force=max(readings["force_N"]),
    )
