"""Functions along paths as polynomials between breaks, from samples that a program takes.

Where the last Chebyshev coefficients of an interpolant have fallen to rounding it is the function.
Where they have not, as at a corner, the piece is halved, down to a width at which a corner is a
point.

References:
    Trefethen 2013, Approximation Theory and Approximation Practice, chapter 8.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int
from numpy.polynomial import chebyshev

from .path_table import PathTable, even

_DEGREE = 16
_AT_ONCE = 4
STATIONS = _AT_ONCE * (_DEGREE + 1)
"""Stations of each path that one evaluation takes."""

_SMALL = 1e-12  # of a function's largest value: what rounding leaves of the last coefficients
_NARROWEST = 1e-9  # of a piece; within it the corner of a function is a point
_CELL = 1 / 32  # of the table's cubics, which then follow the functions to its tolerance

_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
_TO_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(_NODES, _DEGREE))
_DERIVATIVE = np.pad(chebyshev.chebder(np.eye(_DEGREE + 1)), ((0, 1), (0, 0)))

Evaluate = Callable[[Float[np.ndarray, "paths k"]], Float[np.ndarray, "paths k order"]]
"""phi_n at `STATIONS` positions of each path."""


@dataclasses.dataclass(frozen=True)
class ChebyshevPaths:
    """phi_n(s) along paths, s in [0, 1].

    Attributes:
        start: where the pieces begin, 2 for none, shape (paths, pieces).
        width: of the pieces, shape (paths, pieces).
        coefficients: of the Chebyshev polynomials, shape (paths, pieces, degree + 1, order).
    """

    start: Float[np.ndarray, "paths pieces"]
    width: Float[np.ndarray, "paths pieces"]
    coefficients: Float[np.ndarray, "paths pieces terms order"]

    @classmethod
    def of(cls, evaluate: Evaluate, paths: int) -> "ChebyshevPaths":
        """The functions that the samples belong to.

        Args:
            evaluate: takes the samples.
            paths: number of paths.
        """
        pending = [[(k / _AT_ONCE, 1 / _AT_ONCE) for k in range(_AT_ONCE)] for _ in range(paths)]
        found: list[list[tuple[float, float, np.ndarray]]] = [[] for _ in range(paths)]
        size = 0.0
        while any(pending):
            now = np.array([(some + [(0.0, 1.0)] * _AT_ONCE)[:_AT_ONCE] for some in pending])
            start, width = now[..., 0], now[..., 1]
            at = start[..., None] + width[..., None] * (_NODES + 1) / 2
            values = evaluate(at.reshape(paths, -1)).reshape(*at.shape, -1)
            size = np.maximum(size, np.abs(values).max(axis=(1, 2)))
            terms = _TO_COEFFICIENTS @ values
            tail = np.abs(terms[:, :, -3:]).max(axis=2) / np.where(size > 0, size, 1.0)[:, None]
            # Where the geometry ends the values are not numbers, and no halving helps.
            rough = (tail > _SMALL).any(axis=-1) & (width > _NARROWEST)
            for path, some in enumerate(pending):
                sampled, pending[path] = some[:_AT_ONCE], some[_AT_ONCE:]
                for k, (low, wide) in enumerate(sampled):
                    if rough[path, k]:
                        pending[path] += [(low, wide / 2), (low + wide / 2, wide / 2)]
                    else:
                        found[path].append((low, wide, terms[path, k]))
        pieces = max(len(some) for some in found)
        shape = paths, pieces
        starts, widths = np.full(shape, 2.0), np.ones(shape)
        coefficients = np.zeros((*shape, *found[0][0][2].shape))
        for path, some in enumerate(found):
            some.sort(key=lambda piece: piece[0])
            for k, (low, wide, term) in enumerate(some):
                starts[path, k], widths[path, k], coefficients[path, k] = low, wide, term
        return cls(starts, widths, coefficients)

    def __call__(
        self, path: Int[np.ndarray, " k"], s: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, "k order"]:
        """phi_n at positions, each on the path of that index."""
        return self.rows(path, s, derivatives=0)[0]

    def rows(
        self, path: Int[np.ndarray, " k"], s: Float[np.ndarray, " k"], derivatives: int = 2
    ) -> tuple[Float[np.ndarray, "k order"], ...]:
        """phi_n at positions of paths, and its derivatives in s, as those of a `PathTable`."""
        piece = (self.start[path] <= s[:, None]).sum(axis=1) - 1
        width = self.width[path, piece]
        T = chebyshev.chebvander(2 * (s - self.start[path, piece]) / width - 1, _DEGREE)
        terms, found = self.coefficients[path, piece], []
        for _ in range(derivatives + 1):
            found.append((T[:, None, :] @ terms)[:, 0])
            terms = _DERIVATIVE @ terms * (2 / width)[:, None, None]
        return tuple(found)

    def table(self) -> PathTable:
        """Cubics that follow the functions closely enough to show where a sum of them is weakest."""
        grids = []
        for start, width in zip(self.start, self.width, strict=True):
            pieces = [
                low + wide * np.arange(cells) / cells
                for low, wide in zip(start, width, strict=True)
                if low < 1
                for cells in [max(1, round(wide / _CELL))]
            ]
            grids.append(np.append(np.concatenate(pieces), 1.0))
        nodes = even(grids)
        path, s = np.repeat(np.arange(len(nodes)), nodes.shape[1]), nodes.ravel()
        value, slope = (
            rows.reshape(*nodes.shape, -1) for rows in self.rows(path, s, derivatives=1)
        )
        return PathTable(nodes, value, slope)
