"""The record of a muscle that is lengthened and shortened at one nominal pressure."""

import dataclasses

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError

from .cycles import checked_columns

ISOBAR = 0.1
"""Largest spread of the pressure in a record, 5th to 95th percentile over the mean."""


@dataclasses.dataclass(frozen=True)
class CyclicRecord:
    """The record of a muscle that is lengthened and shortened at one nominal pressure.

    Attributes:
        length: L [m], shape (n,), in order of time.
        force: F [N], shape (n,), positive when the muscle pulls.
        pressure: gauge pressure P [Pa], shape (n,).
        rest_length: L0 [m] of zero contraction.
        time: [s], shape (n,), or None.
        source: where the numbers come from.
    """

    length: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    rest_length: float
    time: Float[np.ndarray, " n"] | None = None
    source: str = "arrays"

    def __post_init__(self) -> None:
        columns = {
            "length": self.length,
            "force": self.force,
            "pressure": self.pressure,
            "time": self.time,
        }
        for name, values in checked_columns(columns).items():
            object.__setattr__(self, name, values)
        if not (np.isfinite(self.rest_length) and self.rest_length > 0):
            raise InputError(f"rest_length must be > 0 and finite, got {self.rest_length} m")
        if self.length.min() <= 0:
            raise InputError(
                f"length must be > 0, reading {int(self.length.argmin()) + 1} has "
                f"{self.length.min():.6g} m: is it a displacement or a contraction?"
            )
        low, high = np.percentile(self.pressure, [5, 95])
        if high - low > ISOBAR * abs(self.pressure.mean()):
            raise InputError(
                f"the pressure of one record must be constant within {ISOBAR:.0%}, it spreads "
                f"from {low:.6g} to {high:.6g} Pa: split the record by pressure; where there is "
                "none, give exact zeros"
            )

    @classmethod
    def from_contraction(
        cls,
        contraction: ArrayLike,
        force: ArrayLike,
        pressure: ArrayLike,
        *,
        rest_length: float,
        time: ArrayLike | None = None,
        source: str = "arrays",
    ) -> "CyclicRecord":
        """The record whose contraction (L0 - L)/L0 [-], a fraction, was logged."""
        return cls(
            length=rest_length * (1 - np.asarray(contraction, float)),
            force=np.asarray(force, float),
            pressure=np.asarray(pressure, float),
            rest_length=rest_length,
            time=None if time is None else np.asarray(time, float),
            source=source,
        )

    @property
    def contraction(self) -> Float[np.ndarray, " n"]:
        """Contraction (L0 - L)/L0 [-], positive when shorter."""
        return 1 - self.length / self.rest_length
