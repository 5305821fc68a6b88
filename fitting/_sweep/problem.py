"""The linear problem that a batch of fits shares: columns, target and tables at one geometry.

Readings enter once: the columns of each pressure are compressed by a QR factorisation, [A_p y_p] to
(order + 1) rows. What follows is independent of their number.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

import famjax

from .._convex.path_functions import (
    AbstractPathFunctions,
    DruckerFunctions,
    ScaledFunctions,
    SlopeFunctions,
)
from .._convex.path_table import PathTable, nodes_for
from .._data.force_data import ForceData
from .._errors import InputError
from .._search.build import path_end_at

STATIONS = 17
"""Points of each path at which a constraint is posed from the start."""


class Readings(eqx.Module):
    """Loaded readings by pressure, padded to one length, and the paths.

    Attributes:
        pressure: levels [Pa], increasing, shape (pressures,).
        force, length: [N, m], shape (pressures, readings).
        weight: 1/std, 1 without, 0 where there is no reading; shape (pressures, readings).
        path_end: shortest length [m] of each path, shape (pressures,).
        order: highest of the law.
    """

    pressure: np.ndarray
    force: np.ndarray
    length: np.ndarray
    weight: np.ndarray
    path_end: np.ndarray
    order: int = eqx.field(static=True)

    @property
    def there(self) -> Bool[np.ndarray, "pressures readings"]:
        """Which of the padded readings are readings."""
        return self.weight > 0


def arrange(data: ForceData, rest_length: float, order: int) -> Readings:
    """The readings of a force map by pressure.

    The path at a pressure runs from rest to the longest length at which the muscle is slack there,
    or, where no reading is slack, to the shortest length.

    Args:
        data: the force map.
        rest_length: L0 [m] of the geometry.
        order: highest of the law.

    Raises:
        InputError: a pressure has no loaded reading that is shorter than the rest length.
    """
    loaded = data.loaded
    pressure = data.pressures.level
    levels = np.unique(pressure[loaded])
    at = [np.flatnonzero(loaded & (pressure == level)) for level in levels]
    size = max(order + 1, *(indices.size for indices in at))
    padded = np.stack([np.pad(indices, (0, size - indices.size), mode="edge") for indices in at])
    there = np.arange(size) < np.array([indices.size for indices in at])[:, None]
    std = np.ones_like(data.force) if data.force_std is None else data.force_std
    ends = np.array([path_end_at(data, float(level)) for level in levels])
    short = np.flatnonzero(ends >= rest_length)
    if short.size:
        raise InputError(
            f"at {levels[short[0]] / 1e3:.5g} kPa no reading is shorter than the rest length of "
            f"{rest_length * 1e3:.5g} mm, so that no actuation path begins there: leave that "
            "pressure out"
        )
    return Readings(
        pressure=levels,
        force=data.force[padded],
        length=data.length[padded],
        weight=np.where(there, 1 / std[padded], 0.0),
        path_end=ends,
        order=order,
    )


class Nodes(eqx.Module):
    """Where the tables of a batch's constraints are kept.

    Attributes:
        at: nodes of each path, shape (pressures, nodes).
        grid: indices of those at which constraints are posed from the start, shape (stations,).
    """

    at: np.ndarray
    grid: np.ndarray

    @classmethod
    def of(
        cls, geometry: famjax.geometries.AbstractGeometry, readings: Readings, *, halvings: int = 0
    ) -> "Nodes":
        """Those of the actuation paths of a geometry.

        Args:
            geometry: fixed.
            readings: of the force map.
            halvings: of every cell, each of which brings the cubics closer to the functions.
        """
        pressure, end = jnp.asarray(readings.pressure), jnp.asarray(readings.path_end)
        functions = DruckerFunctions(geometry, pressure, end, readings.order)
        nodes = nodes_for(functions, readings.pressure.size)
        for _ in range(halvings):
            middle = (nodes[:, 1:] + nodes[:, :-1]) / 2
            nodes = np.sort(np.concatenate([nodes, middle], axis=1), axis=1)
        return cls(nodes, stations_of(nodes))


def stations_of(nodes: Float[np.ndarray, "paths nodes"]) -> Int[np.ndarray, " stations"]:
    """Indices of the nodes at which a constraint is posed from the start."""
    return np.linspace(0, nodes.shape[1] - 1, STATIONS).round().astype(int)


class Design(eqx.Module):
    """The linear problem at one geometry: everything that the fits of a sweep share.

    Attributes:
        A: force [N] per coefficient in units of `unit`, shape (pressures, readings, order).
        target: force [N] that the bladder has to explain, shape (pressures, readings).
        weight: of the readings, shape (pressures, readings).
        factor: compressed [A y], weighted, shape (pressures, order + 1, order + 1).
        unit: of each coefficient [Pa], shape (order,).
        slope, drucker: tables of the two constraints, on the scaled coefficients.
        functions: of both, index 0 and 1, path and position to (order,).
        grid: see `Nodes`.
        basis: shares of the coefficients at the lowest and the highest pressure, (pressures, 2).
    """

    A: Float[Array, "pressures readings order"]
    target: Float[Array, "pressures readings"]
    weight: Float[Array, "pressures readings"]
    factor: Float[Array, "pressures rows rows"]
    unit: Float[Array, " order"]
    slope: PathTable
    drucker: PathTable
    functions: tuple[AbstractPathFunctions, AbstractPathFunctions]
    grid: Int[Array, " stations"]
    basis: Float[Array, "pressures 2"]


def design(
    geometry: famjax.geometries.AbstractGeometry,
    deadband: Float[Array, ""],
    readings: Readings,
    nodes: Nodes,
    force: Float[Array, "pressures readings"] | None = None,
) -> Design:
    """The linear problem of readings at a geometry, differentiable in both and in the force.

    Args:
        geometry: fixed.
        deadband: pressure P_d [Pa] before the muscle acts.
        readings: of the force map.
        nodes: of the constraints.
        force: measured [N], in place of that of the readings.
    """
    pressure, length = jnp.asarray(readings.pressure), jnp.asarray(readings.length)
    P = jnp.broadcast_to(pressure[:, None], length.shape)
    order, end = readings.order, jnp.asarray(readings.path_end)
    braid = famjax.Muscle(geometry, famjax.PolynomialMaterial(jnp.zeros(1)), deadband)
    weight = jnp.asarray(readings.weight)

    def bladder(coefficients: Float[Array, " order"]) -> Float[Array, "pressures readings"]:
        material = famjax.PolynomialMaterial(coefficients)
        return famjax.Muscle(geometry, material).bladder_force(length, P)

    A = jax.vmap(bladder, out_axes=-1)(jnp.eye(order))
    measured = jnp.asarray(readings.force) if force is None else force
    target = measured - braid.braid_force(length, P)
    weighted = A * weight[..., None]
    unit = jax.lax.stop_gradient(1 / jnp.sqrt(jnp.sum(weighted**2, axis=(0, 1))))
    functions = (
        ScaledFunctions(SlopeFunctions(_largest_strain(geometry, pressure, end), order), unit),
        ScaledFunctions(DruckerFunctions(geometry, pressure, end, order), unit),
    )
    share = (pressure - pressure[0]) / jnp.maximum(pressure[-1] - pressure[0], 1.0)
    return Design(
        A=A * unit,
        target=target,
        weight=weight,
        factor=jax.vmap(compressed)(weighted * unit, target * weight),
        unit=unit,
        slope=PathTable.at(functions[0], nodes.at),
        drucker=PathTable.at(functions[1], nodes.at),
        functions=functions,
        grid=jnp.asarray(nodes.grid),
        basis=jnp.stack([1 - share, share], axis=-1),
    )


def compressed(A: Float[Array, "k n"], y: Float[Array, " k"]) -> Float[Array, "n+1 n+1"]:
    """Rows with the Gram matrix of [A y]: R and Q^T y, and below them what A cannot reach of y."""
    Q, R = jnp.linalg.qr(A)
    c = Q.T @ y
    square = jnp.sum((y - Q @ c) ** 2)
    rest = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    bottom = jnp.zeros(A.shape[1] + 1, A.dtype).at[-1].set(rest)
    return jnp.concatenate([jnp.concatenate([R, c[:, None]], axis=1), bottom[None]])


def _largest_strain(
    geometry: famjax.geometries.AbstractGeometry,
    pressure: Float[Array, " paths"],
    end: Float[Array, " paths"],
) -> Float[Array, " paths"]:
    """Largest strain magnitude [-] that the material sees along each path."""
    at = geometry.dimensions(
        jnp.stack([jnp.broadcast_to(geometry.rest_length, end.shape), end], axis=-1),
        pressure[:, None],
    )
    hoop = jnp.max(jnp.abs(at.hoop_strain), axis=(-2, -1))
    return jnp.maximum(hoop, jnp.max(jnp.abs(at.axial_strain), axis=-1))
