"""Stability margins at an optimum: where along its paths a law is weakest, between stations too.

The function is interpolated at Chebyshev points. Where the coefficients of the interpolant have
fallen to rounding it is the function to that bound, a polynomial exactly, and its minima are the
roots of its derivative. Where they have not, as at a corner, the path is halved; in the pieces that
stay rough the lowest sample is closed in on, and the bound is what the last samples differ by.

References:
    Trefethen 2013, Approximation Theory and Approximation Practice, chapters 8 and 18.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from numpy.polynomial import chebyshev

from .engine import Point, report_of
from .problem import Part, Problem
from .response import Constraint

_SMALL = 1e-12  # of the largest value: an interpolant whose last coefficients are below is exact
_HALVINGS = 4
_ZOOMS = 7  # each narrows a rough piece to two of the cells between its samples
_REAL = 1e-7  # imaginary part of a root that is a real one but for rounding

Evaluate = Callable[[Float[np.ndarray, "paths k"]], Float[np.ndarray, "paths k"]]
"""Values at positions in [0, 1] of each path."""


@dataclasses.dataclass(frozen=True)
class Margin:
    """The weakest state on each path of a part.

    Attributes:
        position: share of the path in [0, 1], shape (paths,).
        value: modulus there [Pa], shape (paths,); nan where the law has none.
        bound: by how much the true minimum may lie lower, in parts of the largest modulus.
    """

    position: Float[np.ndarray, " paths"]
    value: Float[np.ndarray, " paths"]
    bound: float


def constraint_margin(problem: Problem, point: Point, kind: Constraint) -> list[Margin]:
    """Smallest modulus along the actuation paths, or tangent modulus over the strain range.

    Args:
        problem: whose paths are looked at.
        point: the fit.
        kind: "drucker" for second-order work along the path, "slope" for the law's own tangent.

    Returns:
        One margin for each part. The law is stable where the value is >= 0.
    """
    return [_margin(part, point, place, kind) for place, part in enumerate(problem.parts)]


def _margin(part: Part, point: Point, place: int, kind: str) -> Margin:
    paths, count = part.inputs.stations.shape

    def evaluate(positions: Float[np.ndarray, "paths k"]) -> Float[np.ndarray, "paths k"]:
        found = report_of(part.with_stations(positions), point, place)
        return np.asarray(found.path_modulus if kind == "drucker" else found.slope)

    return Margin(*weakest(evaluate, paths, count))


def weakest(
    evaluate: Evaluate, paths: int, count: int
) -> tuple[Float[np.ndarray, " paths"], Float[np.ndarray, " paths"], float]:
    """Global minimum over [0, 1] of a function, for every path.

    Args:
        evaluate: maps positions of shape (paths, count) to values of that shape.
        paths: number of paths.
        count: number of positions that one evaluation takes.

    Returns:
        (position, value there, bound on what the minimum may lie lower, of the largest magnitude).
    """
    nodes = (1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2
    candidates: list[list[float]] = [[0.0, 1.0] for _ in range(paths)]
    pieces, bound, largest = [(0.0, 1.0)], 0.0, np.finfo(float).tiny
    # Of the pieces that stay rough, the one with the lowest sample of each path.
    rough_low, low_end, high_end = np.full(paths, np.inf), np.zeros(paths), np.ones(paths)
    for halving in range(_HALVINGS + 1):
        halves: dict[tuple[float, float], None] = {}
        for low, high in pieces:
            at = low + (high - low) * nodes
            values = evaluate(np.tile(at, (paths, 1)))
            if not np.isfinite(values).all():
                return np.zeros(paths), np.full(paths, np.nan), np.nan
            largest = max(largest, float(np.abs(values).max()))
            for path in range(paths):
                coefficients = _interpolant(values[path])
                size = max(float(np.abs(values[path]).max()), np.finfo(float).tiny)
                tail = float(np.abs(coefficients[-3:]).max()) / size
                if tail <= _SMALL:
                    bound = max(bound, tail * count)
                    inside = _stationary(coefficients, size)
                    candidates[path] += (low + (high - low) * (inside + 1) / 2).tolist()
                elif halving < _HALVINGS:
                    middle = (low + high) / 2
                    halves |= {(low, middle): None, (middle, high): None}
                elif values[path].min() < rough_low[path]:
                    rough_low[path], k = values[path].min(), int(values[path].argmin())
                    low_end[path], high_end[path] = at[max(k - 1, 0)], at[min(k + 1, count - 1)]
        pieces = list(halves)
        if not pieces:
            break
    if np.isfinite(rough_low).any():
        lowest, left = _closed_in(evaluate, low_end, high_end, count)
        bound = max(bound, left / largest)
        for path in np.flatnonzero(np.isfinite(rough_low)):
            candidates[path].append(float(lowest[path]))
    return *_best(evaluate, candidates, count), bound


def _closed_in(
    evaluate: Evaluate,
    low: Float[np.ndarray, " paths"],
    high: Float[np.ndarray, " paths"],
    count: int,
) -> tuple[Float[np.ndarray, " paths"], float]:
    """The lowest sample between two positions of each path, and by how much its neighbours differ [Pa]."""
    rows, spread = np.arange(low.size), np.inf
    for _ in range(_ZOOMS):
        at = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, count)
        values = evaluate(at)
        best = values.argmin(axis=1)
        low, high = at[rows, np.maximum(best - 1, 0)], at[rows, np.minimum(best + 1, count - 1)]
        spread = float(np.max(np.ptp(values, axis=1)))
    return (low + high) / 2, spread


def _interpolant(values: Float[np.ndarray, " count"]) -> Float[np.ndarray, " count"]:
    """Chebyshev coefficients of the polynomial through values at -cos(pi k / degree)."""
    values, degree = values[::-1], values.size - 1
    coefficients = np.fft.rfft(np.concatenate([values, values[-2:0:-1]])).real / degree
    coefficients[[0, -1]] /= 2
    return coefficients


def _stationary(coefficients: Float[np.ndarray, " count"], size: float) -> Float[np.ndarray, " k"]:
    """Real roots in (-1, 1) of the derivative."""
    kept = np.flatnonzero(np.abs(coefficients) > 1e-14 * size)
    if not kept.size or kept[-1] < 2:
        return np.zeros(0)
    roots = chebyshev.chebroots(chebyshev.chebder(coefficients[: kept[-1] + 1]))
    real = roots[np.abs(roots.imag) < _REAL].real
    return real[np.abs(real) < 1]


def _best(
    evaluate: Evaluate, candidates: list[list[float]], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The lowest of the candidates of each path, by the function itself."""
    width = -(-max(len(of_path) for of_path in candidates) // count) * count
    at = np.array([of_path + [of_path[-1]] * (width - len(of_path)) for of_path in candidates])
    parts = np.split(at, width // count, axis=1)
    values = np.concatenate([evaluate(part) for part in parts], axis=1)
    best, rows = np.argmin(values, axis=1), np.arange(len(candidates))
    return at[rows, best], values[rows, best]
