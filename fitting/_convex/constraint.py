"""A constraint on the coefficients along paths: its rows, and where a law comes nearest to it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..engine.qp import unit_rows
from .path_functions import AbstractPathFunctions
from .path_table import PathTable

_MATTERS = 1e-4  # slack per largest coefficient, far above what cubics may miss at a corner


class Points(eqx.Module):
    """Positions s in [0, 1] of paths; a negative path is none."""

    path: Int[Array, " k"]
    s: Float[Array, " k"]


class Dips(eqx.Module):
    """The two weakest local minima of the constraint on each path: first all weakest, then others.

    Attributes:
        at: where they are.
        slack: there, per largest coefficient; infinite where there is none.
        station: whether the constraint is posed there from the start.
    """

    at: Points
    slack: Float[Array, " k"]
    station: Bool[Array, " k"]


class Constraint(eqx.Module):
    """A constraint on the coefficients at some paths, as rows on the unknowns y.

    The coefficients at the path p are E = basis_p x, with x = to_x y.

    Attributes:
        table: of the functions that must not be negative along each path.
        exact: the functions themselves, for the rows of the last step.
        grid: indices of the nodes at which the constraint is posed from the start, (stations,).
        positive: True for E_n >= 0, which the table does not express.
        on: False for no constraint at all.
        basis: of the coefficients over pressure at the paths, shape (paths, basis).
        to_x: from y to the coefficients of the basis, shape (order, basis, n).
        used: coefficients that the law has, shape (order,).
    """

    table: PathTable
    exact: AbstractPathFunctions
    grid: Int[Array, " stations"]
    positive: Bool[Array, ""]
    on: Bool[Array, ""]
    basis: Float[Array, "paths basis"]
    to_x: Float[Array, "order basis n"]
    used: Bool[Array, " order"]

    def coefficients(self, y: Float[Array, " n"]) -> Float[Array, "paths order"]:
        """E_n [Pa] at the paths."""
        return jnp.einsum("pb,ebn,n->pe", self.basis, self.to_x, y)

    def on_y(self, phi: Float[Array, "k order"], path: Int[Array, " k"]) -> Float[Array, "k n"]:
        """Rows on y of rows on the coefficients of paths; zero where there is no constraint."""
        phi = jnp.where(self.used & self.on & (path >= 0)[:, None], phi, 0.0)
        return jnp.einsum("ke,kb,ebn->kn", phi, self.basis[path], self.to_x)

    def grid_rows(self) -> tuple[Float[Array, "m n"], Float[Array, " m"]]:
        """The rows posed from the start."""
        paths, order, stations = self.basis.shape[0], self.used.shape[0], self.grid.shape[0]
        units = jnp.eye(stations, order)
        phi = jnp.where(self.positive, units, self.table.value[:, self.grid])
        return posed(self.on_y(phi.reshape(-1, order), jnp.repeat(jnp.arange(paths), stations)))

    def cubic_rows(self, at: Points) -> Float[Array, "k n"]:
        """Rows at points, of the cubics, not scaled."""
        return self.on_y(self.table.rows(at.path, at.s)[0], at.path)

    def exact_rows(self, at: Points, y: Float[Array, " n"]) -> Float[Array, "k n"]:
        """Rows at points, not scaled: of the functions themselves wherever y comes near to zero."""
        cubic = self.table.rows(at.path, at.s)[0]
        coefficients = self.coefficients(jax.lax.stop_gradient(y))
        slack = jnp.sum(cubic * coefficients[at.path], axis=1)
        near = slack <= _MATTERS * jnp.max(jnp.abs(coefficients))
        near &= self.on & (at.path >= 0) & ~self.exact.cubic & ~self.table.at_node(at.path, at.s)
        return self.on_y(_exact_where(near, self.exact, cubic, at), at.path)

    def dips(self, y: Float[Array, " n"]) -> Dips:
        """Where the constraint is weakest."""
        coefficients = self.coefficients(y)
        least, s = self.table.minima(coefficients)
        beside = jnp.pad(least, ((0, 0), (1, 1)), constant_values=jnp.inf)
        local = (least < beside[:, :-2]) & (least <= beside[:, 2:])
        depth = jnp.where(local, least, jnp.inf)
        paths = jnp.arange(depth.shape[0])
        first = jnp.argmin(depth, axis=1)
        others = depth.at[paths, first].set(jnp.inf)
        second = jnp.argmin(others, axis=1)
        slack = jnp.concatenate([depth[paths, first], others[paths, second]])
        largest = jnp.max(jnp.abs(coefficients))
        there = self.on & ~self.positive & (slack < jnp.inf) & (largest > 0)
        slack = jnp.where(there, slack, jnp.inf) / jnp.where(largest > 0, largest, 1.0)
        both = jnp.concatenate([s[paths, first], s[paths, second]])
        twice = jnp.tile(paths, 2)
        station = jnp.any(both[:, None] == self.table.nodes[:, self.grid][twice], axis=1)
        return Dips(Points(jnp.where(there, twice, -1), both), slack, station)

    def touching(
        self, y: Float[Array, " n"], at: Points, multipliers: Float[Array, " k"]
    ) -> tuple[Points, Float[Array, "n n"]]:
        """Dips after a Newton step towards g' = 0, and the curvature that moving them adds."""
        _, first, second = (self.on_y(rows, at.path) for rows in self.table.rows(at.path, at.s))
        bend = jax.lax.stop_gradient(second @ y)
        free = ~self.table.at_node(at.path, at.s) & (bend > 0)
        bend = jnp.where(free, bend, 1.0)
        s = jnp.clip(at.s - jnp.where(free, first @ y / bend, 0.0), 0.0, 1.0)
        weight = jnp.where(free, multipliers / bend, 0.0)
        return Points(at.path, s), jnp.einsum("k,kn,km->nm", weight, first, first)


def posed(rows: Float[Array, "m n"]) -> tuple[Float[Array, "m n"], Float[Array, " m"]]:
    """Unit rows with their offsets; empty ones are off."""
    G, h, _ = unit_rows(rows, jnp.zeros(rows.shape[0]))
    return G, jnp.where(jnp.any(G != 0, axis=1), h, -1.0)


@eqx.filter_custom_jvp
def _exact_where(
    near: Bool[Array, " k"],
    functions: AbstractPathFunctions,
    cubic: Float[Array, "k order"],
    at: Points,
) -> Float[Array, "k order"]:
    """The functions at points that are near, and the cubics elsewhere.

    The functions are costly. A loop that is not entered costs nothing, and a batch enters it only
    where one of its members has to. Its state holds the positions and changes them, or the compiler
    would evaluate the functions before the loop.
    """

    def evaluate(state: tuple) -> tuple:
        _, left, s = state
        phi = jnp.where(near[:, None], functions(jnp.maximum(at.path, 0), s), cubic)
        return phi, jnp.zeros_like(left), jnp.zeros_like(s)

    return jax.lax.while_loop(lambda state: jnp.any(state[1]), evaluate, (cubic, near, at.s))[0]


@_exact_where.def_jvp
def _exact_where_jvp(primals: tuple, tangents: tuple) -> tuple:
    def of(functions: AbstractPathFunctions, cubic: Array, at: Points) -> Array:
        exact = functions(jnp.maximum(at.path, 0), at.s)
        return jnp.where(primals[0][:, None], exact, cubic)

    return eqx.filter_jvp(of, primals[1:], tangents[1:])
