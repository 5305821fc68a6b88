"""How far predictions are off: from the readings that were left out, growing away from the measured.

And from what models that fit the readings alike disagree about (`disagreement`), which no reading that was
left out need show.

What a law does not know of a muscle is a smooth function of length (and of pressure), zero to within
the noise where it was measured. Between and beyond the measured lengths its variance is that of the
natural cubic spline's error (kriging with the generalised covariance |h|^3 and a linear drift), times
one number. The lengths that were left out tell it, and before them a prior that is the same for
every muscle: three or four lengths say little of how far a law may be off, and fewer nothing.
Readings of one length are off together, so there are as many independent errors as lengths, and the
interval is Student's.

References:
    Cressie 1993, Statistics for Spatial Data, section 5.4 (splines as kriging).
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from famjax.boundary.units import si_unit

from ..data.force_data import ForceData
from .left_out import LeftOut

PRIOR_SCALE = 0.08
"""Prior of what lengths add, in parts of the largest force: a law that fits a muscle to 1 % misses
the lengths beyond its map by a few per cent of the largest force."""

PRIOR_FREEDOM = 1.5
"""Number of lengths left out that the prior counts as."""

DISAGREEMENT = 1.75
"""Times the root mean square difference to the models that fit alike: half the width of what they add to
the band. Two of them may be off to the same side."""

FLOOR = 0.002
"""Of the largest force: what every band holds on either side, whatever the readings say."""

_NODES, _HALVINGS = 64, 60  # for Student's quantile; to import SciPy for it takes 0.2 s
_WIENER = 12  # |h|^3 is so many times the covariance of white noise that is integrated twice
_NEAR = 1e-6  # variance of the spline one hundredth of the range from what is known


@dataclasses.dataclass(frozen=True)
class Along:
    """What one coordinate, length or pressure, adds to the error.

    Attributes:
        levels: measured [m or Pa], ascending.
        scale: standard deviation [N] where the spline's is 1.
        freedom: of the scale: levels that were left out, and how many the prior stands for.
    """

    levels: Float[np.ndarray, " levels"]
    scale: float
    freedom: float

    def variance(self, at: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Variance [N^2] at lengths or pressures."""
        return self.scale**2 * spline_variance(self.levels, at)


@dataclasses.dataclass(frozen=True)
class ModelError:
    """Errors of predictions of single readings.

    Attributes:
        noise: standard deviation [N] at what was measured.
        length, pressure: what they add.
        floor: half the width of the narrowest band [N], see `FLOOR`.
    """

    noise: float
    length: Along
    pressure: Along
    floor: float

    def std(
        self, length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Standard deviation [N] of a reading about its prediction, disagreement of models apart."""
        at_length, at_pressure = np.asarray(length, float), np.asarray(pressure, float)
        added = self.length.variance(at_length) + self.pressure.variance(at_pressure)
        return np.sqrt(self.noise**2 + added)

    def factor(self, coverage: float = 0.95) -> float:
        """Standard deviations on either side of an interval of that coverage, by Student."""
        return student(coverage, min(self.length.freedom, self.pressure.freedom))

    def half_band(
        self,
        length: Float[np.ndarray, " n"],
        pressure: Float[np.ndarray, " n"],
        disagreement: Float[np.ndarray, " n"] | float = 0.0,
        coverage: float = 0.95,
    ) -> Float[np.ndarray, " n"]:
        """Half the width [N] of the band of single readings.

        Args:
            length: [m].
            pressure: gauge [Pa].
            disagreement: root mean square difference [N] to the models that fit alike.
            coverage: of the band.
        """
        own = self.factor(coverage) * self.std(length, pressure)
        return np.hypot(own, DISAGREEMENT * np.asarray(disagreement) + self.floor)

    @property
    def narrowest(self) -> float:
        """Half the width [N] of the 95 % band where the model is known best, at what was measured."""
        return math.hypot(self.factor() * self.noise, self.floor)

    @property
    def covers(self) -> str:
        """What the interval covers, in a sentence."""
        judged = [
            f"{name}s left out"
            for name, along in (("length", self.length), ("pressure", self.pressure))
            if along.freedom > PRIOR_FREEDOM
        ]
        shown = (
            f"as {' and '.join(judged)} show it" if judged else "as a prior for all muscles has it"
        )
        return (
            f"single readings: their noise, the error of the model {shown}, growing with the distance "
            "from what was measured, and what models that fit the readings alike disagree about"
            + ("" if self.length.freedom > PRIOR_FREEDOM
               else "; too few lengths to leave one out, so the error in length is a prior's")
        )  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, SI."""
        return {
            "noise_N": self.noise,
            "floor_N": self.floor,
            "factor_95": self.factor(),
            **{
                name: {
                    f"levels_{si_unit(name)}": along.levels.tolist(),
                    "scale_N": along.scale,
                    "freedom": along.freedom,
                }
                for name, along in (("length", self.length), ("pressure", self.pressure))
            },
            "covers": self.covers,
        }

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "ModelError":
        """Back from `as_dict`."""

        def along(name: str) -> Along:
            one = document[name]
            return Along(np.array(one[f"levels_{si_unit(name)}"]), one["scale_N"], one["freedom"])

        return cls(document["noise_N"], along("length"), along("pressure"), document["floor_N"])


def model_error(
    data: ForceData,
    residual: Float[np.ndarray, " points"],
    left_out: Mapping[str, LeftOut],
    unknowns: int,
) -> ModelError:
    """The error of predictions, from the errors on what was left out.

    Args:
        data: the map.
        residual: prediction less reading [N] at the loaded readings, in sample.
        left_out: errors by "length" and "pressure", where there are any.
        unknowns: numbers that the readings determined.
    """
    freedom = max(residual.size - unknowns, 1)
    noise = math.sqrt(float(residual @ residual) / freedom)
    lengths, pressures = (
        np.unique(levels.level[data.loaded]) for levels in (data.lengths, data.pressures)
    )
    scale = PRIOR_SCALE * data.max_force
    return ModelError(
        noise,
        _along(lengths, left_out.get("length"), noise, scale),
        _along(pressures, left_out.get("pressure"), noise, scale),
        FLOOR * data.max_force,
    )


def _along(levels: np.ndarray, left_out: LeftOut | None, noise: float, prior: float) -> Along:
    """The scale at which the spline's variance gives the errors of the groups left out.

    A level beside another tells next to nothing of it: of what is left of its error without the noise,
    chance is more than its share where the prior would have it below the noise, and it counts as one
    where the two are equal.
    """
    ratios, least = [], max(_NEAR, (noise / prior) ** 2)
    if left_out is None:
        return Along(levels, prior, PRIOR_FREEDOM)
    for group in np.unique(left_out.group):
        mine = left_out.group == group
        own = np.unique(left_out.level[mine])
        others = levels[~np.isin(levels, own)]
        expected = max(float(np.mean(spline_variance(others, own))), least)
        excess = max(float(np.mean(left_out.error[mine] ** 2)) - noise**2, 0.0)
        ratios.append(excess / expected)
    freedom = PRIOR_FREEDOM + len(ratios)
    return Along(levels, math.sqrt((PRIOR_FREEDOM * prior**2 + sum(ratios)) / freedom), freedom)


def spline_variance(
    known: Float[np.ndarray, " levels"], at: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Variance of a natural cubic spline's error, of covariance |h|^3 in parts of the range.

    Args:
        known: where the function is known, ascending.
        at: where it is wanted.

    Returns:
        Zero at what is known, growing between and, more, beyond.
    """
    span = float(np.ptp(known)) or float(known[0])
    x, t = (known - known[0]) / span, (np.asarray(at, float) - known[0]) / span
    if x.size == 1:  # one level tells no drift: the function is as uncertain as it is far
        return np.abs(t - x[0]) ** 3
    gap = np.diff(x)
    own, shared = _slopes(gap)
    i = np.clip(np.searchsorted(x, t, side="right") - 1, 0, gap.size - 1)
    beyond = np.maximum(np.maximum(x[0] - t, t - x[-1]), 0.0)
    h, u = gap[i], np.clip((t - x[i]) / gap[i], 0.0, 1.0)
    left, right = h * u * (1 - u) ** 2, -h * u**2 * (1 - u)  # of the slopes, as Hermite has them
    between = left**2 * own[i] + 2 * left * right * shared[i] + right**2 * own[i + 1]
    pinned = (h * u * (1 - u)) ** 3 / 3
    ends = beyond**2 * np.where(t < x[0], own[0], own[-1]) + beyond**3 / 3
    return _WIENER * (between + pinned + ends)


def _slopes(gap: Float[np.ndarray, " gaps"]) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the slope at each level, and covariance of the slopes at neighbours.

    A function whose second derivative is white noise is, between two levels, Hermite's cubic of values
    and slopes and a noise of its own. So the slopes have a tridiagonal precision, that of the cubic's
    bending energy, and a sweep from either end gives what is wanted of its inverse.
    """
    diagonal = 4 * (np.append(1 / gap, 0.0) + np.append(0.0, 1 / gap))
    beside = 2 / gap
    down, up = diagonal.copy(), diagonal.copy()
    for i in range(gap.size):
        down[i + 1] -= beside[i] ** 2 / down[i]
        up[-i - 2] -= beside[-i - 1] ** 2 / up[-i - 1]
    own = 1 / (down + up - diagonal)
    return own, -beside / down[:-1] * own[1:]


def student(coverage: float, freedom: float) -> float:
    """Standard deviations on either side of Student's interval, to 1e-9 of them.

    Where t = tan(phi) the density is smooth over all phi, whatever the freedom, and Gauss's formula
    gives what lies within an interval.

    Args:
        coverage: of the interval, 0.99 at most.
        freedom: from 1 to 1e5, whole or not.
    """
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    half = (freedom + 1) / 2
    peak = math.lgamma(half) - math.lgamma(freedom / 2) - math.log(math.pi * freedom) / 2

    def within(phi: float) -> float:
        t = np.tan(phi * (1 + node) / 2)
        density = np.exp(peak - half * np.log1p(t**2 / freedom))
        return float(weight @ (density * (1 + t**2))) * phi

    low, high = 0.0, math.pi / 2
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if within(middle) < coverage else (low, middle)
    return math.tan((low + high) / 2)
