"""Polynomials in length and pressure at every position, fitted to pictures by least squares."""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .pictures import Pictures

Array = NDArray[np.floating]

_SPREAD = 0.02
"""Spread of the pressures [part of their largest] from which on the shape may depend on them."""


class SurfaceForm(NamedTuple):
    """Polynomials of a surface: in the length, and times the pressure.

    Attributes:
        degree: of the polynomial in length.
        with_pressure: of the one in length that is multiplied by the pressure; -1 for none.
    """

    degree: int
    with_pressure: int


@dataclasses.dataclass(frozen=True)
class PolynomialFit:
    """Least squares at every position with one matrix.

    Attributes:
        form: polynomials.
        ends: shortest and longest length [m].
        pressures: lowest and highest [Pa].
        coefficients: shape (terms, m) [m].
        residuals: of each picture [m], shape (n, m).
        leverage: of each picture, shape (n,).
        solve: pseudo-inverse of the matrix, shape (terms, n).
    """

    form: SurfaceForm
    ends: tuple[float, float]
    pressures: tuple[float, float]
    coefficients: Array
    residuals: Array
    leverage: Array
    solve: Array

    def basis(self, length: Array, pressure: Array) -> Array:
        """The terms at states, shape (n, terms)."""
        return _basis(self.form, self.ends, self.pressures, length, pressure)

    @property
    def left_out(self) -> Array:
        """Residual of each picture from the surface without it [m], shape (n, m)."""
        return self.residuals / np.maximum(1 - self.leverage, 1e-9)[:, None]

    def varied(self, rng: np.random.Generator) -> Array:
        """Coefficients as probable as these: every picture's residual with a random sign and size."""
        sizes = rng.standard_normal(len(self.leverage))[:, None]
        return self.coefficients + self.solve @ (sizes * self.left_out)

    def variance(self, length: Array, pressure: Array) -> Array:
        """Of a new picture's diameters there [m2], shape (n, m)."""
        terms = self.basis(length, pressure) @ self.solve
        scatter = np.sum(self.residuals**2, axis=0) / max(len(self.leverage) - len(self.solve), 1)
        return (1 + np.sum(terms**2, axis=1))[:, None] * scatter


def fit_polynomials(pictures: Pictures, form: SurfaceForm) -> PolynomialFit:
    """Least squares of a form through pictures, each counting alike."""
    ends = float(pictures.length.min()), float(pictures.length.max())
    pressures = pressure_ends(pictures)
    X = _basis(form, ends, pressures, pictures.length, pictures.pressure)
    solve = np.linalg.pinv(X)
    coefficients = solve @ pictures.diameter
    leverage = np.sum(X * solve.T, axis=1)
    return PolynomialFit(
        form, ends, pressures, coefficients, pictures.diameter - X @ coefficients, leverage, solve
    )


def _basis(
    form: SurfaceForm,
    ends: tuple[float, float],
    pressures: tuple[float, float],
    length: Array,
    pressure: Array,
) -> Array:
    """Chebyshev polynomials in the length, then those times the pressure, each in [-1, 1]."""
    low, high = ends
    terms = np.polynomial.chebyshev.chebvander(
        (2 * length - low - high) / (high - low), form.degree
    )
    if form.with_pressure < 0:
        return terms
    low, high = pressures
    share = (2 * pressure - low - high) / (high - low)
    return np.hstack([terms, share[:, None] * terms[:, : form.with_pressure + 1]])


def pressure_ends(pictures: Pictures) -> tuple[float, float]:
    """Lowest and highest pressure [Pa]; nan where they are not known or all alike."""
    known = pictures.pressure
    if not np.isfinite(known).all() or np.ptp(known) <= _SPREAD * np.abs(known).max():
        return np.nan, np.nan
    return float(known.min()), float(known.max())
