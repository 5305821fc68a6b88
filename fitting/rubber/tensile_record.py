"""The record of a cyclic tensile test, and where its branches come back to zero force."""

import dataclasses

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError

from .cycles import Branch, checked_columns

_ZERO_WINDOW = (0.02, 0.20)  # of the peak force: readings from which zero force is found


@dataclasses.dataclass(frozen=True)
class TensileRecord:
    """The record of a cyclic tensile test on a strip or tube, in order of time.

    Attributes:
        force: F [N], shape (n,), positive in tension.
        displacement: d [m], shape (n,), of the grips; zero at the gauge length.
        gauge_length: l0 [m], unloaded length between the grips before the test.
        area: A0 [m2], unloaded cross-section of the rubber before the test.
        time: [s], shape (n,), or None.
        source: where the numbers come from.
    """

    force: Float[np.ndarray, " n"]
    displacement: Float[np.ndarray, " n"]
    gauge_length: float
    area: float
    time: Float[np.ndarray, " n"] | None = None
    source: str = "arrays"

    def __post_init__(self) -> None:
        columns = {"force": self.force, "displacement": self.displacement, "time": self.time}
        for name, values in checked_columns(columns).items():
            object.__setattr__(self, name, values)
        for name, unit in (("gauge_length", "m"), ("area", "m2")):
            size = getattr(self, name)
            if not (np.isfinite(size) and size > 0):
                raise InputError(f"{name} must be > 0 and finite, got {size} {unit}")
        length = self.gauge_length + self.displacement.min()
        if length <= 0:
            raise InputError(
                f"a displacement of {self.displacement.min():.6g} m shortens the gauge length of "
                f"{self.gauge_length:.6g} m to {length:.6g} m: check the units and the zero"
            )

    @property
    def volume(self) -> float:
        """Volume [m3] of the rubber between the grips, A0 l0; constant."""
        return self.area * self.gauge_length

    @property
    def true_stress(self) -> Float[np.ndarray, " n"]:
        """True stress [Pa] at constant volume, F l / V with l = l0 + d: F/A (1 + eps)."""
        return self.force * (self.gauge_length + self.displacement) / self.volume


def zero_force(record: TensileRecord, branch: Branch) -> tuple[float, float]:
    """Displacement [m] at which a branch's force is zero, and its standard error; nan if never."""
    way = slice(None, None, 1 if branch.rising else -1)
    force, x, y = (
        column[branch.rows][way]
        for column in (record.force, record.displacement, record.true_stress)
    )
    # The window's ends are looked for in a running mean, so that noise does not draw them in.
    span = 2 * (force.size // 100) + 1
    smooth = np.convolve(np.pad(force, span // 2, mode="edge"), np.ones(span) / span, "valid")
    low, high = (part * smooth.max() for part in _ZERO_WINDOW)
    stop = int(np.argmax(smooth >= high))
    slack = np.flatnonzero(smooth[:stop] <= low)
    if smooth.max() <= 0 or not slack.size or stop - slack[-1] < 6:
        return np.nan, np.nan
    near = slice(int(slack[-1]) + 1, stop)
    (c0, c1, c2), covariance = parabola(x[near] - x[near][0], y[near])
    square = c1**2 - 4 * c0 * c2
    if c1 <= 0 or square <= 0:
        return np.nan, np.nan
    t = -2 * c0 / (c1 + np.sqrt(square))
    row = np.array([1.0, t, t**2])
    return float(x[near][0] + t), float(np.sqrt(row @ covariance @ row / square))


def parabola(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Coefficients, constant first, of the parabola that fits best, and their covariance; n > 3."""
    scale = np.abs(x).max() ** np.arange(3)
    powers = np.vander(x, 3, increasing=True)
    inverse = np.linalg.pinv(powers / scale) / scale[:, None]
    residual = y - powers @ inverse @ y
    return inverse @ y, inverse @ inverse.T * (residual @ residual / (x.size - 3))
