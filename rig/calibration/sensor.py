"""One sensor: from the sum of five readings of the converter to a value with its error."""

import dataclasses
import math
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import RigError

READINGS = 5
"""Readings of the converter in one record's sum."""
FULL_SCALE = 1023 * READINGS
"""Largest sum of a record [counts]."""


@dataclasses.dataclass(frozen=True)
class Sensor:
    """A linear sensor, neglecting curvature, which shows in `scatter`.

    value = gain (counts - zero), counts the sum of five readings of 10 bits.

    Attributes:
        gain: [unit/count], not zero.
        zero: counts at value zero; may lie outside 0..5115.
        gain_std: standard error of the gain [unit/count].
        zero_std: standard error of the zero [counts].
        correlation: of the two errors, in [-1, 1].
        scatter: root mean square [unit] of the references about the line, n - 2 degrees of freedom.
    """

    gain: float
    zero: float
    gain_std: float = math.inf
    zero_std: float = math.inf
    correlation: float = 0.0
    scatter: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gain) and self.gain != 0 and math.isfinite(self.zero)):
            raise RigError(
                f"a sensor's gain must be finite and not zero and its zero finite, got gain "
                f"{self.gain} per count, zero {self.zero} counts"
            )

    @classmethod
    def from_range(cls, low: tuple[float, float], high: tuple[float, float]) -> Self:
        """A sensor from two pairs of its data sheet, (counts, value); the errors are unknown.

        >>> Sensor.from_range((500.0, 0.0), (4500.0, 1e6)).gain
        250.0
        """
        if low[0] == high[0]:
            raise RigError(f"the two pairs need different counts, got {low[0]} twice")
        gain = (high[1] - low[1]) / (high[0] - low[0])
        return cls(gain, low[0] - low[1] / gain if gain else 0.0)

    def value(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Values [unit] of counts, any shape."""
        return self.gain * (np.asarray(counts, np.float64) - self.zero)

    def counts(self, value: float) -> float:
        """Counts at which a value [unit] reads, not rounded."""
        return self.zero + value / self.gain

    def error(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Standard error [unit] of values, from the calibration alone, any shape."""
        if not (math.isfinite(self.gain_std) and math.isfinite(self.zero_std)):
            return np.full(np.shape(counts), math.inf)
        from_zero = np.asarray(counts, np.float64) - self.zero
        a, b = from_zero * self.gain_std, -self.gain * self.zero_std
        return np.sqrt(a * a + b * b + 2 * self.correlation * a * b)


def fit_sensor(counts: ArrayLike, references: ArrayLike) -> Sensor:
    """The sensor that reads the references best, neglecting the references' own errors.

    Least squares of counts = zero + references / gain: the counts are noisy, the references are not.

    Args:
        counts: mean counts at each reference, shape (n,), n >= 3, strictly between 0 and 5115.
        references: what was applied [unit], shape (n,), two different values at least.

    Returns:
        The sensor with the standard errors of both parameters and their correlation.

    Raises:
        RigError: too few or equal references, counts at the converter's end, or no response.

    References:
        Draper & Smith 1998, Applied Regression Analysis, section 1.7 (inverse regression).

    >>> sensor = fit_sensor([500, 1500, 2500, 3500], [0.0, 1e5, 2e5, 3e5])
    >>> round(sensor.gain, 9), round(sensor.zero, 6)
    (100.0, 500.0)
    """
    y, x = np.asarray(counts, np.float64), np.asarray(references, np.float64)
    if y.ndim != 1 or y.shape != x.shape:
        raise RigError(f"counts and references must have one shape (n,), got {y.shape}, {x.shape}")
    if y.size < 3:
        raise RigError(f"a sensor's errors need three references or more, got {y.size}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise RigError("counts and references must be finite; leave out what was not read")
    bad = np.flatnonzero((y <= 0) | (y >= FULL_SCALE))
    if bad.size:
        raise RigError(
            f"reading {bad[0] + 1} is {y[bad[0]]:g} counts, the end of the converter's range "
            f"0..{FULL_SCALE}; leave it out or check the wiring"
        )
    spread = float(np.sum((x - x.mean()) ** 2))
    if spread == 0:
        raise RigError(f"all references are {x[0]:g}; apply two different ones at least")
    slope = float(np.sum((x - x.mean()) * (y - y.mean()))) / spread
    zero = float(y.mean() - slope * x.mean())
    variance = float(np.sum((y - zero - slope * x) ** 2)) / (y.size - 2)
    slope_std = math.sqrt(variance / spread)
    if abs(slope) <= 3 * slope_std or slope == 0:
        raise RigError(
            f"the counts do not follow the references: {slope:.3g} +- {slope_std:.1g} counts per "
            "unit; check the wiring and the order of the table"
        )
    zero_std = math.sqrt(variance * (1 / y.size + x.mean() ** 2 / spread))
    # gain = 1/slope turns the sign of its correlation with the zero
    correlation = variance * x.mean() / spread / (slope_std * zero_std) if variance else 0.0
    gain = 1 / slope
    scatter = math.sqrt(variance) * abs(gain)
    return Sensor(gain, zero, slope_std * gain * gain, zero_std, float(correlation), scatter)
