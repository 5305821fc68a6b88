"""Turns and length of the braid's threads, from lengths and diameters of one muscle."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

Array = NDArray[np.floating]

WITHIN = 0.15
"""Part by which the true turns may differ from the triangle's, which neglects the narrower ends."""


@dataclasses.dataclass(frozen=True)
class Threads:
    """The triangle relation B^2 = L^2 + (pi N D)^2 as pictures show it.

    Attributes:
        length: B [m], without pressure where it depends on it.
        turns: N.
        length_std, turns_std: standard errors.
        compliance: rise of B^2 with the pressure, over B^2 [1/Pa]; 0 where it was not looked for.
        compliance_std: its standard error.
    """

    length: float
    turns: float
    length_std: float
    turns_std: float
    compliance: float = 0.0
    compliance_std: float = 0.0

    def turns_range(self) -> tuple[float, float]:
        """Least and most turns between which a fit of the force seeks them."""
        return self.turns * (1 - WITHIN), self.turns * (1 + WITHIN)


def fit_threads(length: Array, diameter: Array, pressure: Array) -> Threads:
    """The threads whose triangle goes through all pictures, neglecting the shape of the ends.

    Least squares of L^2 = B^2 (1 + c P) - (pi N)^2 D^2 over the pictures.

    Args:
        length: active lengths L [m], shape (n,).
        diameter: average diameters D [m], shape (n,).
        pressure: gauge [Pa], shape (n,); c = 0 where it is not known or alike in all.

    Raises:
        InputError: the muscle does not thicken as it shortens.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    scale = float(np.mean(length**2))
    columns = [np.ones_like(length), -(diameter**2) / np.mean(diameter**2)]
    known = np.isfinite(pressure).all() and np.ptp(pressure) > 0.02 * np.abs(pressure).max()
    unit = float(np.abs(pressure).max()) if known else 1.0
    if known:
        columns.append(pressure / unit)
    X, y = np.stack(columns, axis=1), length**2 / scale
    solve = np.linalg.pinv(X)
    found = solve @ y
    rest = y - X @ found
    covariance = solve @ solve.T * float(rest @ rest) / max(len(y) - X.shape[1], 1)
    std = np.sqrt(np.diag(covariance))
    if found[0] <= 0 or found[1] <= 0:
        raise InputError(
            "the muscle does not thicken as it shortens, by its pictures: no braid can be found; "
            "check that lengths and diameters are of one muscle over a whole stroke"
        )
    thread = float(np.sqrt(found[0] * scale))
    turns = float(np.sqrt(found[1] * scale / np.mean(diameter**2)) / np.pi)
    compliance = (found[2] / found[0] / unit, std[2] / found[0] / unit) if known else (0.0, 0.0)
    return Threads(
        thread, turns, thread * std[0] / found[0] / 2, turns * std[1] / found[1] / 2,
        float(compliance[0]), float(compliance[1]),
    )  # fmt: skip
