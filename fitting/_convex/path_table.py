"""Constraints along the actuation path as piecewise cubics, whose minima are found exactly.

A constraint asks g(s) = sum_n E_n phi_n(s) >= 0 for all s in [0, 1] along a path. phi_n is kept by
its values and slopes at nodes, and between them as the cubic that these determine. The combination
is then a cubic in each cell and its minima are roots of a quadratic: nothing is missed between
nodes. The tangent modulus of a law up to order 4 is such a cubic; for other functions the nodes are
set so closely that the cubics are the function to `TOLERANCE`.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .objectives import AnyArray, namespace

TOLERANCE = 1e-8
"""Largest difference between a function and its cubics, per largest value of the function."""

_FIRST_CELLS = 16
_NARROWEST = 1e-5  # of a cell; at a corner of the function no width is narrow enough
_INSIDE = 1e-12  # where the first slope is taken: |strain| has a corner at the start
_BATCH = 64


PathFunctions = Callable[[Int[Array, " k"], Float[Array, " k"]], Float[Array, "k order"]]
"""phi_n at positions s, each on the path of that index; see `AbstractPathFunctions`."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class PathTable:
    """phi_n and its derivative at the nodes of each path, in JAX's arrays or in NumPy's.

    Attributes:
        nodes: positions s in [0, 1], from 0 to 1, shape (paths, nodes).
        value: phi_n, shape (paths, nodes, order).
        slope: d(phi_n)/ds, shape (paths, nodes, order).
    """

    nodes: Float[AnyArray, "paths nodes"]
    value: Float[AnyArray, "paths nodes order"]
    slope: Float[AnyArray, "paths nodes order"]

    @classmethod
    def at(cls, phi: PathFunctions, nodes: Float[AnyArray, "paths nodes"]) -> "PathTable":
        """The table of the functions at given nodes."""
        nodes = jnp.asarray(nodes)
        paths = jnp.arange(nodes.shape[0])
        value = jax.vmap(lambda s: phi(paths, s), in_axes=1, out_axes=1)(nodes)
        inside = jnp.maximum(nodes, _INSIDE)
        return cls(nodes, value, _value_and_slope(phi, inside)[1])

    def rows(
        self, path: Int[AnyArray, " k"], s: Float[AnyArray, " k"]
    ) -> tuple[Float[AnyArray, "k order"], Float[AnyArray, "k order"], Float[AnyArray, "k order"]]:
        """The cubics at positions of paths: phi_n, d(phi_n)/ds and its derivative."""
        xp = namespace(self.nodes)
        nodes = self.nodes[path]
        cell = xp.clip(xp.sum(nodes <= s[:, None], axis=1) - 1, 0, nodes.shape[1] - 2)
        start, end = self.nodes[path, cell], self.nodes[path, cell + 1]
        width, t = (end - start)[:, None], ((s - start) / (end - start))[:, None]
        f0, f1 = self.value[path, cell], self.value[path, cell + 1]
        d0, d1 = self.slope[path, cell] * width, self.slope[path, cell + 1] * width
        q, r = 3 * (f1 - f0) - 2 * d0 - d1, d0 + d1 - 2 * (f1 - f0)
        value = f0 + t * (d0 + t * (q + t * r))
        return value, (d0 + t * (2 * q + 3 * t * r)) / width, (2 * q + 6 * t * r) / width**2

    def at_node(self, path: Int[AnyArray, " k"], s: Float[AnyArray, " k"]) -> Bool[AnyArray, " k"]:
        """Whether positions are nodes, at which the cubics are the functions."""
        return (self.nodes[path] == s[:, None]).any(axis=1)

    def minima(
        self, coefficients: Float[AnyArray, "paths order"]
    ) -> tuple[Float[AnyArray, "paths cells"], Float[AnyArray, "paths cells"]]:
        """Smallest value of sum_n E_n phi_n in each cell, and the position where it is."""
        xp = namespace(self.nodes)
        value = (self.value @ coefficients[..., None])[..., 0]
        slope = (self.slope @ coefficients[..., None])[..., 0]
        width = self.nodes[:, 1:] - self.nodes[:, :-1]
        f0, f1, d0, d1 = value[:, :-1], value[:, 1:], slope[:, :-1] * width, slope[:, 1:] * width
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
        start, end = self.nodes[:, :-1], self.nodes[:, 1:]
        s = xp.where(dips, start + inside * width, xp.where(f0 <= f1, start, end))
        return xp.where(dips, at, ends), s


def _value_and_slope(
    phi: PathFunctions, s: Float[Array, "paths k"]
) -> tuple[Float[Array, "paths k order"], Float[Array, "paths k order"]]:
    paths = jnp.arange(s.shape[0])
    return jax.vmap(
        lambda s: jax.jvp(lambda at: phi(paths, at), (s,), (jnp.ones_like(s),)),
        in_axes=1,
        out_axes=1,
    )(s)


def nodes_for(phi: PathFunctions, n_paths: int) -> Float[np.ndarray, "paths nodes"]:
    """Nodes at which cubics follow the functions to `TOLERANCE`.

    Every cell half-way along which they do not is halved.

    Args:
        phi: the functions.
        n_paths: number of paths.

    Returns:
        Nodes from 0 to 1.
    """

    def evaluated(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        count = s.shape[1]
        padded = np.pad(s, ((0, 0), (0, -count % _BATCH)), mode="edge")
        batches = np.split(padded, padded.shape[1] // _BATCH, 1)
        parts = [_inside(phi, jnp.asarray(batch)) for batch in batches]
        value, slope = (
            np.concatenate(column, axis=1)[:, :count] for column in zip(*parts, strict=True)
        )
        return value, slope

    grids = [np.linspace(0, 1, _FIRST_CELLS + 1)] * n_paths
    while True:
        nodes = even(grids)
        value, slope = evaluated(nodes)
        middle, _ = evaluated((nodes[:, 1:] + nodes[:, :-1]) / 2)
        width = np.diff(nodes, axis=1)
        cubic = (value[:, 1:] + value[:, :-1]) / 2
        cubic += width[..., None] * (slope[:, :-1] - slope[:, 1:]) / 8
        largest = np.abs(value).max(axis=1, keepdims=True)
        wrong = (np.abs(cubic - middle) > TOLERANCE * largest).any(axis=-1)
        wrong &= width > _NARROWEST
        if not wrong.any():
            return nodes
        grids = [
            np.union1d(row, ((row[1:] + row[:-1]) / 2)[halve])
            for row, halve in zip(nodes, wrong, strict=True)
        ]


@eqx.filter_jit
def _inside(
    phi: PathFunctions, s: Float[Array, "paths k"]
) -> tuple[Float[Array, "paths k order"], Float[Array, "paths k order"]]:
    """Value and slope, compiled once for all functions of one kind."""
    return _value_and_slope(phi, jnp.maximum(s, _INSIDE))


def even(grids: list[np.ndarray]) -> Float[np.ndarray, "paths nodes"]:
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
