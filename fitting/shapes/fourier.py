"""A diameter profile as a truncated Fourier series with a free wave number."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]

_WAVES = (0.5, 4 * np.pi)
_SCAN = 160
_STARTS = 4
_SCAN_POINTS = 400
_SPAN = 1e-10  # singular values below this part of the largest carry rounding only


@dataclasses.dataclass(frozen=True)
class FourierFit:
    """D(x) = a0 + sum over n of a_n cos(n w x) + b_n sin(n w x), x = z / L in [0, 1].

    `mean`, `cosines`, `sines`, `frequency` are the arguments a0, a, b, w of a Fourier profile of
    the muscle's model. As the terms of a wide profile nearly cancel each other, every digit is
    needed, and single coefficients have large errors where the curve has small ones.

    Attributes:
        mean: a0 [m].
        cosines, sines: a_n, b_n [m], shape (n_terms,).
        frequency: w [-].
        covariance: of (a0, a_1, ..., b_1, ..., w) for residuals that are independent over
            `correlation` points, shape (2 n_terms + 2, 2 n_terms + 2).
        rmse: root mean square of the residuals [m].
        max_error: largest residual [m].
        sse: sum of their squares [m^2].
        r_squared, adjusted_r_squared: part of the variance that is explained, and that corrected
            for the number of coefficients.
        correlation: points over which residuals are correlated, 1 for white ones.
        symmetric: b_n = a_n tan(n w / 2) was imposed.
    """

    mean: float
    cosines: Array
    sines: Array
    frequency: float
    covariance: Array
    rmse: float
    max_error: float
    sse: float
    r_squared: float
    adjusted_r_squared: float
    correlation: float
    symmetric: bool

    @property
    def stderr(self) -> Array:
        """Standard errors of (a0, a_1, ..., b_1, ..., w), shape (2 n_terms + 2,)."""
        return np.sqrt(np.diag(self.covariance))

    def diameter(self, x: ArrayLike) -> Array:
        """D [m] at x [-], of its shape."""
        x = np.asarray(x, float)
        angle = np.arange(1, self.cosines.size + 1) * self.frequency * x[..., None]
        return self.mean + np.cos(angle) @ self.cosines + np.sin(angle) @ self.sines


def fit_fourier(
    x: ArrayLike, diameter: ArrayLike, *, n_terms: int = 3, symmetric: bool = False
) -> FourierFit:
    """The series that fits a profile best, wherever the wave number would be started.

    For a given w the coefficients are linear: the least squares over w alone has many valleys, so
    it is scanned from 0.5 to 4 pi, and the deepest valleys are followed down by Gauss-Newton with
    the coefficients eliminated (variable projection).

    Args:
        x: positions over the length, in [0, 1], shape (n,).
        diameter: D [m], shape (n,).
        n_terms: harmonics; 0 gives the mean.
        symmetric: fit a profile that is even about x = 1/2.

    Returns:
        The fit.

    Raises:
        ValueError: shapes that differ, values that are not finite, or fewer points than twice the
            number of coefficients.

    References:
        Chambers 2021, section 4.3, table 4.2; Golub and Pereyra 1973.
    """
    x, diameter = np.asarray(x, float), np.asarray(diameter, float)
    unknowns = (n_terms + 2) if symmetric else (2 * n_terms + 2)
    if x.ndim != 1 or x.shape != diameter.shape or x.size < 2 * unknowns:
        raise ValueError(
            f"x and diameter have one shape (n,), n >= {2 * unknowns} for {n_terms} terms; got "
            f"{x.shape} and {diameter.shape}"
        )
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(diameter))):
        raise ValueError("x and diameter must be finite")
    if n_terms < 0:
        raise ValueError(f"n_terms must be >= 0, got {n_terms}")
    w = _best_wave(x, diameter, n_terms, symmetric) if n_terms else np.pi
    return _described(x, diameter, n_terms, symmetric, w)


def _functions(x: Array, w: float, n_terms: int, symmetric: bool) -> Array:
    """Columns 1, then cos(n w (x - 1/2)), then, unless symmetric, the sines of the same."""
    angle = np.arange(1, n_terms + 1) * w * (x[:, None] - 0.5)
    parts = [np.ones((x.size, 1)), np.cos(angle)]
    return np.hstack(parts if symmetric else [*parts, np.sin(angle)])


def _solved(functions: Array, y: Array) -> tuple[Array, Array]:
    """Coefficients of the functions by least squares, and what they leave over."""
    coefficients = np.asarray(np.linalg.lstsq(functions, y, rcond=_SPAN)[0], np.float64)
    return coefficients, y - functions @ coefficients


def _best_wave(x: Array, y: Array, n_terms: int, symmetric: bool) -> float:
    thin = slice(None, None, max(1, x.size // _SCAN_POINTS))
    x, y = x[thin], y[thin] / (np.ptp(y) or 1.0)

    def left_over(w: Array) -> Array:
        return _solved(_functions(x, w[0], n_terms, symmetric), y)[1]

    waves = np.geomspace(*_WAVES, _SCAN)
    depth = np.array([np.sum(left_over(np.array([w])) ** 2) for w in waves])
    inner = np.flatnonzero((depth[1:-1] <= depth[:-2]) & (depth[1:-1] <= depth[2:])) + 1
    starts = sorted({*inner.tolist(), int(np.argmin(depth))}, key=lambda i: depth[i])[:_STARTS]
    fits = [
        least_squares(left_over, waves[[i]], bounds=_WAVES, xtol=1e-12, ftol=1e-12)
        for i in starts
        if _WAVES[0] < waves[i] < _WAVES[1]
    ]
    found = [(fit.cost, float(fit.x[0])) for fit in fits]
    return min(found + [(0.5 * depth[i], float(waves[i])) for i in (0, _SCAN - 1)])[1]


def _described(x: Array, y: Array, n_terms: int, symmetric: bool, w: float) -> FourierFit:
    """The fit with this wave number: its coefficients about the end, and how good it is."""
    functions = _functions(x, w, n_terms, symmetric)
    solved, off = _solved(functions, y)
    cosine = solved[1 : n_terms + 1]
    sine = np.zeros(n_terms) if symmetric else solved[n_terms + 1 :]
    n = np.arange(1, n_terms + 1)
    c, s = np.cos(n * w / 2), np.sin(n * w / 2)
    cosines, sines = cosine * c - sine * s, cosine * s + sine * c
    reach = n * (x[:, None] - 0.5)
    by_w = (reach * np.cos(w * reach)) @ sine - (reach * np.sin(w * reach)) @ cosine
    jacobian = np.column_stack([functions, by_w]) if n_terms else functions
    # From (a0, A, B, w) about the middle to (a0, a, b, w) about the end.
    turn = np.zeros((2 * n_terms + 2, jacobian.shape[1]))
    turn[0, 0] = 1
    a, b = slice(1, n_terms + 1), slice(n_terms + 1, 2 * n_terms + 1)
    turn[a, a], turn[b, a] = np.diag(c), np.diag(s)
    if not symmetric:
        turn[a, b], turn[b, b] = np.diag(-s), np.diag(c)
    if n_terms:
        turn[:, -1] = np.concatenate([[0], -(n / 2) * sines, (n / 2) * cosines, [1]])
    sse = float(off @ off)
    variance = float(np.sum((y - y.mean()) ** 2))
    freedom = x.size - jacobian.shape[1]
    r_squared = 1 - sse / variance if variance > 0 else 0.0
    correlation = _correlated_points(off)
    inner = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-15, hermitian=True)
    return FourierFit(
        mean=float(solved[0]),
        cosines=cosines,
        sines=sines,
        frequency=w,
        covariance=turn @ inner @ turn.T * (sse / freedom * correlation),
        rmse=float(np.sqrt(sse / x.size)),
        max_error=float(np.abs(off).max()),
        sse=sse,
        r_squared=r_squared,
        adjusted_r_squared=1 - (1 - r_squared) * (x.size - 1) / freedom,
        correlation=correlation,
        symmetric=symmetric,
    )


def _correlated_points(off: Array) -> float:
    """Points over which residuals are correlated, 1 + 2 sum of their autocorrelations while > 0."""
    power = float(off @ off)
    if power == 0:
        return 1.0
    lags = np.array([off[k:] @ off[: off.size - k] for k in range(1, off.size // 2)]) / power
    return float(1 + 2 * lags[: np.argmax([*(lags <= 0), True])].sum())
