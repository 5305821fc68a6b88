"""Functions along actuation paths, and where a sum of them is weakest.

A constraint asks g(s) = sum_n E_n phi_n(s) >= 0 for all s in [0, 1] along a path. phi_n is kept as
polynomials between breaks, from samples that a program takes. Where the last Chebyshev coefficients
of an interpolant have fallen to rounding it is the function. Where they have not, as at a corner,
the piece is halved, down to a width at which a corner is a point.

Cubics that follow the functions closely show where a sum of them is weakest: in each cell it is a
cubic too, whose minimum is the root of a quadratic, so that nothing is missed between the nodes.

References:
    Trefethen 2013, Approximation Theory and Approximation Practice, chapter 8.
"""

import dataclasses
from collections.abc import Callable, Sequence

import jax
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial import chebyshev

from .arrays import AnyArray, namespace

_DEGREE = 16
_AT_ONCE = 4
SAMPLES = _AT_ONCE * (_DEGREE + 1)
"""Positions of each path that one evaluation takes."""

_SMALL = 1e-12  # of a function's largest value: what rounding leaves of the last coefficients
_NARROWEST = 1e-9  # of a piece; within it the corner of a function is a point
_CELL = 1 / 32  # of the table's cubics, which then follow the functions closely

_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
_TO_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(_NODES, _DEGREE))
_DERIVATIVE = np.pad(chebyshev.chebder(np.eye(_DEGREE + 1)), ((0, 1), (0, 0)))

Evaluate = Callable[[Float[np.ndarray, "paths k"]], Float[np.ndarray, "paths k order"]]
"""phi_n at `SAMPLES` positions of each path."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class PathFunctions:
    """phi_n(s) along paths, s in [0, 1].

    Attributes:
        start: where the pieces begin, 2 for none, shape (1, paths, pieces): shared by all fits.
        width: of the pieces, shape (1, paths, pieces).
        terms: coefficients of the Chebyshev polynomials of phi_n, of its first and of its second
            derivative in s, shape (1, paths, pieces, 3, degree + 1, order).
    """

    start: Float[AnyArray, "1 paths pieces"]
    width: Float[AnyArray, "1 paths pieces"]
    terms: Float[AnyArray, "1 paths pieces 3 terms order"]

    @classmethod
    def of(cls, evaluate: Evaluate, corners: Sequence[np.ndarray]) -> "PathFunctions":
        """The functions that the samples belong to.

        Args:
            evaluate: takes the samples.
            corners: positions of the corners that are known, of each path as many as it has. Others
                are found by halving, which takes many samples.
        """
        paths, pending = len(corners), [_between(known) for known in corners]
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
        shape = paths, max(len(some) for some in found)
        starts, widths = np.full(shape, 2.0), np.ones(shape)
        coefficients = np.zeros((*shape, *found[0][0][2].shape))
        for path, some in enumerate(found):
            some.sort(key=lambda piece: piece[0])
            for k, (low, wide, term) in enumerate(some):
                starts[path, k], widths[path, k], coefficients[path, k] = low, wide, term
        each = [coefficients]
        for _ in range(2):
            each.append(_DERIVATIVE @ each[-1] * (2 / widths)[..., None, None])
        return cls(starts[None], widths[None], np.stack(each, axis=2)[None])

    def rows(
        self, path: Int[AnyArray, "*#batch"], s: Float[AnyArray, "*batch"], derivatives: int = 0
    ) -> tuple[Float[AnyArray, "*batch order"], ...]:
        """phi_n at positions of paths, and its derivatives in s."""
        xp = namespace(s)
        piece = (self.start[0, path] <= s[..., None]).sum(axis=-1) - 1
        x = 2 * (s - self.start[0, path, piece]) / self.width[0, path, piece] - 1
        T = [xp.ones_like(x), x]
        while len(T) <= _DEGREE:
            T.append(2 * x * T[-1] - T[-2])
        terms = self.terms[0, path, piece, : derivatives + 1]
        found = (xp.stack(T, axis=-1)[..., None, None, :] @ terms)[..., 0, :]
        return tuple(found[..., k, :] for k in range(derivatives + 1))

    def scaled(self, unit: Float[np.ndarray, " order"]) -> "PathFunctions":
        """The functions times the unit of each coefficient."""
        return dataclasses.replace(self, terms=self.terms * unit)

    def table(self) -> "PathTable":
        """Cubics that follow the functions."""
        grids = []
        for start, width in zip(self.start[0], self.width[0], strict=True):
            pieces = [
                low + wide * np.arange(cells) / cells
                for low, wide in zip(start, width, strict=True)
                if low < 1
                for cells in [max(1, round(wide / _CELL))]
            ]
            grids.append(np.append(np.concatenate(pieces), 1.0))
        nodes = _even(grids)
        return PathTable(nodes, *self.rows(np.arange(len(nodes))[:, None], nodes, derivatives=1))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class PathTable:
    """phi_n and its derivative at nodes along paths, and between them the cubics of these.

    Attributes:
        nodes: positions s in [0, 1], from 0 to 1, shape (..., paths, nodes).
        value: phi_n, shape (..., paths, nodes, order).
        slope: d(phi_n)/ds, shape (..., paths, nodes, order).
    """

    nodes: Float[AnyArray, "*batch paths nodes"]
    value: Float[AnyArray, "*batch paths nodes order"]
    slope: Float[AnyArray, "*batch paths nodes order"]

    def minima(
        self, coefficients: Float[AnyArray, "*batch paths order"]
    ) -> tuple[
        Float[AnyArray, "*batch paths cells"],
        Float[AnyArray, "*batch paths cells"],
        Bool[AnyArray, "*batch paths cells"],
    ]:
        """Smallest value of sum_n E_n phi_n in each cell, where it is, and whether at no node."""
        xp = namespace(coefficients)
        value = (self.value @ coefficients[..., None])[..., 0]
        slope = (self.slope @ coefficients[..., None])[..., 0]
        start, end = self.nodes[..., :-1], self.nodes[..., 1:]
        width = end - start
        f0, f1 = value[..., :-1], value[..., 1:]
        d0, d1 = slope[..., :-1] * width, slope[..., 1:] * width
        # f0 + d0 t + q t^2 + r t^3 has its minimum at the larger root of 3 r t^2 + 2 q t + d0 for
        # r > 0, at the smaller for r < 0; both are written so that nothing cancels.
        q, r = 3 * (f1 - f0) - 2 * d0 - d1, d0 + d1 - 2 * (f1 - f0)
        square = q**2 - 3 * r * d0
        root = xp.sqrt(xp.maximum(square, 0.0))
        over = xp.where(q > 0, q + root, 3 * r)
        inside = xp.where(q > 0, -d0, root - q) / xp.where(over == 0, 1.0, over)
        dips = (square > 0) & (over != 0) & (inside > 0) & (inside < 1)
        inside = xp.where(dips, inside, 0.0)
        at = f0 + inside * (d0 + inside * (q + inside * r))
        ends = xp.minimum(f0, f1)
        dips = dips & (at < ends)
        s = xp.where(dips, start + inside * width, xp.where(f0 <= f1, start, end))
        return xp.where(dips, at, ends), s, dips


def _between(corners: Float[np.ndarray, " corners"]) -> list[tuple[float, float]]:
    """Start and width of the pieces between corners, of four at least."""
    inner = np.sort(corners[(corners > _NARROWEST) & (corners < 1 - _NARROWEST)])
    apart = np.diff(inner, prepend=0.0) > _NARROWEST
    edges = np.concatenate([[0.0], inner[apart], [1.0]])
    while edges.size <= _AT_ONCE:
        widest = np.argmax(np.diff(edges))
        edges = np.insert(edges, widest + 1, (edges[widest] + edges[widest + 1]) / 2)
    return list(zip(edges[:-1].tolist(), np.diff(edges).tolist(), strict=True))


def _even(grids: list[np.ndarray]) -> Float[np.ndarray, "paths nodes"]:
    """The grids in one array; the widest cells of the shorter ones are halved."""
    longest = max(grid.size for grid in grids)
    even = []
    for grid in grids:
        nodes = grid
        while nodes.size < longest:
            widest = np.argsort(-np.diff(nodes), kind="stable")[: longest - nodes.size]
            nodes = np.sort(np.append(nodes, ((nodes[1:] + nodes[:-1]) / 2)[widest]))
        even.append(nodes)
    return np.stack(even)
