"""One identification problem as pure functions of the geometry: design matrix, constraint rows.

The force is linear in the coefficients E_n, so for each geometry the fit is a convex programme.
What makes it "free", "linear" or "fixed" in pressure is a basis over pressure; what makes it
"positive", "slope" or "drucker" is a set of rows. Every case has the same shape: blocks of
independent programmes, each with `basis` times `order` unknowns.
"""

import math
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from ._data import ForceData
from ._geometry_source import AbstractGeometrySource
from ._parameters import GEOMETRY, Bounds, coefficient_names
from ._qp import Optimum, solve_qp

Constraint = Literal["none", "positive", "slope", "drucker"]
PressureDependence = Literal["fixed", "linear", "free"]

CONSTRAINTS: tuple[Constraint, ...] = ("none", "positive", "slope", "drucker")
DEPENDENCES: tuple[PressureDependence, ...] = ("fixed", "linear", "free")

STATIONS = 49
"""Stations along the actuation path at which the constraint is posed from the start."""
EXCHANGES = 8
"""Spare stations, filled with the points between the others where the constraint is violated."""


class Problem(eqx.Module):
    """A force map, a form of the law and a constraint.

    Attributes:
        force, pressure, length: loaded readings [N, Pa, m], shape (points,).
        weights: of the readings in each block, 1/std or 1, 0 where not in it: (blocks, points).
        basis: of the coefficients over pressure at the readings, shape (points, basis).
        path_pressure: pressures [Pa] of the paths on which the constraint holds, (blocks, paths).
        path_basis: basis there, shape (blocks, paths, basis).
        path_end: shortest length [m] of each path, shape (blocks, paths); all start at rest.
        stations: parts of the path in [0, 1], shape (blocks, paths, stations).
        coefficient_min, coefficient_max: bounds [Pa], shape (order,), infinite where there is none.
        source: makes the geometry of its parameters.
        rest_length: L0 [m], where every path starts.
        order: of the polynomial law.
        constraint: on the coefficients.
    """

    force: Float[Array, " points"]
    pressure: Float[Array, " points"]
    length: Float[Array, " points"]
    weights: Float[Array, "blocks points"]
    basis: Float[Array, "points basis"]
    path_pressure: Float[Array, "blocks paths"]
    path_basis: Float[Array, "blocks paths basis"]
    path_end: Float[Array, "blocks paths"]
    stations: Float[Array, "blocks paths stations"]
    coefficient_min: Float[Array, " order"]
    coefficient_max: Float[Array, " order"]
    source: AbstractGeometrySource
    rest_length: float = eqx.field(static=True)
    order: int = eqx.field(static=True)
    constraint: Constraint = eqx.field(static=True)

    @property
    def constraint_rows_per_path(self) -> int:
        """Number of rows that the constraint has on each path."""
        stations = self.stations.shape[-1]
        counts = {"none": 0, "positive": self.order, "slope": stations, "drucker": stations}
        return counts[self.constraint]

    @property
    def n_coefficients(self) -> int:
        """Number of linear unknowns in all blocks."""
        return self.weights.shape[0] * self.basis.shape[1] * self.order

    def muscle(
        self, geometry: Float[Array, " 3"], material: famjax.AbstractMaterial
    ) -> famjax.Muscle:
        """The muscle with this geometry (`GEOMETRY`, SI) and material."""
        diameter, angle, deadband = geometry
        return famjax.Muscle(self.source.geometry(diameter, angle), material, deadband)

    def _unit_laws(
        self, geometry: Float[Array, " 3"], quantity: str
    ) -> Float[Array, "*shape order"]:
        """Bladder force at the readings, or path modulus at the stations, of each E_n = 1 Pa."""

        def of_law(coefficients: Float[Array, " order"]) -> Float[Array, "*shape"]:
            muscle = self.muscle(geometry, famjax.PolynomialMaterial(coefficients))
            if quantity == "bladder_force":
                return muscle.bladder_force(self.length, self.pressure)
            return famjax.path_modulus(
                muscle.material, muscle.geometry, self.path_lengths(), self.path_pressure[..., None]
            )

        return jax.vmap(of_law, out_axes=-1)(jnp.eye(self.order))

    def path_lengths(self) -> Float[Array, "blocks paths stations"]:
        """Active lengths [m] of the stations."""
        rest = self.rest_length
        return rest + self.stations * (self.path_end - rest)[..., None]

    def largest_strain(self, geometry: Float[Array, " 3"]) -> Float[Array, "blocks paths"]:
        """Largest strain magnitude [-] that the material sees along each path."""
        muscle = self.muscle(geometry, famjax.PolynomialMaterial(jnp.zeros(1)))
        rest = jnp.full_like(self.path_end, self.rest_length)
        ends = jnp.stack([rest, self.path_end], axis=-1)
        at = muscle.geometry.dimensions(ends, self.path_pressure[..., None])
        hoop = jnp.max(jnp.abs(at.hoop_strain), axis=-1)
        return jnp.max(jnp.maximum(hoop, jnp.abs(at.axial_strain)), axis=-1)

    def constraint_rows(
        self, geometry: Float[Array, " 3"]
    ) -> Float[Array, "blocks paths stations order"]:
        """Rows on the coefficients at each path's pressure, in Pa: the constraint asks >= 0."""
        shape = (*self.path_end.shape, 0, self.order)
        if self.constraint == "none":
            return jnp.zeros(shape)
        if self.constraint == "positive":
            return jnp.broadcast_to(jnp.eye(self.order), (*shape[:2], self.order, self.order))
        if self.constraint == "slope":
            powers = jnp.arange(1, self.order + 1)
            strain = self.largest_strain(geometry)[..., None] * self.stations
            return powers * strain[..., None] ** (powers - 1)
        return self._unit_laws(geometry, "path_modulus")

    def programmes(
        self, geometry: Float[Array, " 3"]
    ) -> tuple[
        Float[Array, "blocks k n"],
        Float[Array, "blocks k"],
        Float[Array, "blocks m n"],
        Float[Array, "blocks m"],
    ]:
        """The convex programmes (A, b, G, h) of all blocks at this geometry."""
        blocks, n = self.weights.shape[0], self.basis.shape[1] * self.order
        columns = self.basis[:, :, None] * self._unit_laws(geometry, "bladder_force")[:, None, :]
        A = self.weights[..., None] * columns.reshape(-1, n)
        braid = self.muscle(geometry, famjax.PolynomialMaterial(jnp.zeros(1)))
        b = self.weights * (self.force - braid.braid_force(self.length, self.pressure))
        rows = self.constraint_rows(geometry)
        rows = self.path_basis[..., None, :, None] * rows[..., None, :]
        limits = jnp.concatenate([self.coefficient_min, -self.coefficient_max])
        signs = jnp.concatenate([jnp.eye(self.order), -jnp.eye(self.order)])
        on = jnp.isfinite(limits)
        signs = jnp.where(on[:, None], signs, 0.0)
        bound_rows = self.path_basis[..., None, :, None] * signs[:, None, :]
        G = jnp.concatenate(
            [rows.reshape(blocks, -1, n), bound_rows.reshape(blocks, -1, n)], axis=1
        )
        paths = self.path_end.shape[1]
        h = jnp.concatenate(
            [
                jnp.zeros(rows.reshape(blocks, -1, n).shape[1]),
                jnp.tile(jnp.where(on, limits, -1.0), paths),
            ]
        )
        return A, b, G, jnp.broadcast_to(h, (blocks, h.shape[0]))

    def solve(self, geometry: Float[Array, " 3"]) -> Optimum:
        """The certified optimum of every block at this geometry, with a leading axis of blocks."""
        return jax.vmap(solve_qp)(*self.programmes(geometry))

    def residual(self, geometry: Float[Array, " 3"]) -> Float[Array, " points"]:
        """Weighted residual of the best coefficients at this geometry: the projected variables."""
        A, b, _, _ = self.programmes(geometry)
        return jnp.sum(jnp.einsum("bkn,bn->bk", A, self.solve(geometry).x) - b, axis=0)

    def material(self, x: Float[Array, "blocks n"]) -> famjax.AbstractMaterial:
        """The material of the blocks' coefficients."""
        blocks, n = x.shape
        nodes = x.reshape(blocks * n // self.order, self.order)
        if nodes.shape[0] == 1:
            return famjax.PolynomialMaterial(nodes[0])
        pressures = self.path_pressure.reshape(-1)
        if blocks == 1:
            pressures = jnp.stack([pressures[0], pressures[-1]])
        return famjax.PressurePolynomialMaterial(pressures, nodes)


def build_problem(
    data: ForceData,
    *,
    order: int,
    constraint: Constraint,
    dependence: PressureDependence,
    bounds: dict[str, Bounds],
    source: AbstractGeometrySource,
) -> Problem:
    """The problem of a force map.

    The actuation path at a pressure runs from rest to the longest length at which the muscle is
    slack there, so that it includes the free contraction; where no reading is slack, to the
    shortest length. A law fixed in pressure has one path, to the shortest length in the map.
    """
    loaded = data.loaded
    pressure = data.pressure[loaded]
    levels = np.unique(pressure)
    weights = 1 / data.force_std[loaded] if data.force_std is not None else np.ones(pressure.size)
    ends = np.array([_path_end(data, level) for level in levels])
    if dependence == "fixed":
        weights = weights[None]
        basis = np.ones((pressure.size, 1))
        path_pressure, path_end = levels[None, -1:], np.array([[data.length.min()]])
        path_basis = np.ones((1, 1, 1))
    elif dependence == "linear":
        weights = weights[None]
        basis = _linear_basis(pressure, levels)
        path_pressure, path_end = levels[None], ends[None]
        path_basis = _linear_basis(levels, levels)[None]
    else:
        weights = weights * (pressure == levels[:, None])
        basis = np.ones((pressure.size, 1))
        path_pressure, path_end = levels[:, None], ends[:, None]
        path_basis = np.ones((levels.size, 1, 1))
    stations = np.concatenate([np.linspace(0, 1, STATIONS), np.zeros(EXCHANGES)])
    names = coefficient_names(order)
    return Problem(
        force=jnp.asarray(data.force[loaded]),
        pressure=jnp.asarray(pressure),
        length=jnp.asarray(data.length[loaded]),
        weights=jnp.asarray(weights),
        basis=jnp.asarray(basis),
        path_pressure=jnp.asarray(path_pressure),
        path_basis=jnp.asarray(path_basis),
        path_end=jnp.asarray(path_end),
        stations=jnp.asarray(np.broadcast_to(stations, (*path_end.shape, stations.size))),
        coefficient_min=jnp.asarray([bounds[name].min for name in names]),
        coefficient_max=jnp.asarray([bounds[name].max for name in names]),
        source=source,
        rest_length=data.specimen.rest_length,
        order=order,
        constraint=constraint,
    )


def _linear_basis(pressure: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Shares of the coefficients at the lowest and the highest pressure, shape (..., 2)."""
    share = (pressure - levels[0]) / (levels[-1] - levels[0]) if levels.size > 1 else 0 * pressure
    return np.stack([1 - share, share], axis=-1)


def _path_end(data: ForceData, level: float) -> float:
    at = data.pressure == level
    shortest_loaded = data.length[at & data.loaded].min()
    slack = data.length[at & ~data.loaded & (data.length < shortest_loaded)]
    return float(slack.max(initial=-math.inf)) if slack.size else float(shortest_loaded)


def geometry_bounds(bounds: dict[str, Bounds]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of `GEOMETRY` [SI], shape (3,) each."""
    return (
        np.array([bounds[name].min for name in GEOMETRY]),
        np.array([bounds[name].max for name in GEOMETRY]),
    )
