"""Response of a model in a fit: force and constraint, linear in the coefficients.

A family builds models from named numbers. The force is affine in some of them, the coefficients. At
nonlinear parameters p and coefficients x0

    F(x) = force + columns (x - x0),   g(x) = rows (x - x0) + values >= 0,

This is traced code, which the engine differentiates in p.
"""

import abc
import math
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from .convex import AnyArray

Values = Mapping[str, Any]
"""Numbers [SI] by name."""

RIG = ("series_compliance", "series_exponent")
"""Parameters of the rig, not of the model: compliance and exponent in `famjax.muscle.give_way`."""


class AbstractFamily(eqx.Module):
    """Models of one specimen as a function of named numbers.

    Arrays in it may differ between specimens without a new program. Static fields (names, classes)
    may not.

    Attributes:
        nonlinear: names of the searched numbers, in order.
    """

    nonlinear: eqx.AbstractVar[tuple[str, ...]]

    @property
    @abc.abstractmethod
    def linear(self) -> tuple[str, ...]:
        """Names of the coefficients, in which the force is affine, in order."""

    @abc.abstractmethod
    def build(self, values: Values) -> Any:
        """Build the model: any object with `force(length, pressure)`."""

    @abc.abstractmethod
    def rest_length(self, values: Values) -> Float[Array, ""]:
        """Active length L0 [m] at which every actuation path starts."""

    @property
    def derived_names(self) -> tuple[str, ...]:
        """Names of the quantities that `derived` returns."""
        return ()

    def derived(self, values: Values) -> tuple[Float[Array, ""], ...]:
        """Further quantities for the report; differentiable."""
        del values
        return ()


Constraint = Literal["none", "positive", "slope", "drucker"]

CONSTRAINTS: tuple[Constraint, ...] = ("none", "positive", "slope", "drucker")
DEPENDENCES = ("fixed", "linear", "free")


STATIONS = 32
"""Stations of each actuation path: 24 from the start and 8 for points found between them."""


class MapInputs(eqx.Module):
    """States at which a model is evaluated: readings and actuation paths.

    Attributes:
        length, pressure, force: readings [m, Pa, N], shape (points,).
        path_pressure: pressure [Pa] of each path, shape (paths,).
        path_end: shortest length [m] of each path, shape (paths,); all start at rest.
        stations: positions along the path in [0, 1], shape (paths, stations).
    """

    length: Float[AnyArray, " points"]
    pressure: Float[AnyArray, " points"]
    force: Float[AnyArray, " points"]
    path_pressure: Float[AnyArray, " paths"]
    path_end: Float[AnyArray, " paths"]
    stations: Float[AnyArray, "paths stations"]


class Linear(NamedTuple):
    """Linear model of one part at a point; its derivatives in the parameters have the same form.

    Attributes:
        force: force [N] with all coefficients zero, shape (points,).
        columns: derivative of the force in the coefficients, shape (points, n).
        values: constraint along the paths [Pa] with all coefficients zero, shape (rows,).
        rows: derivative of the constraint in the coefficients, shape (rows, n).
    """

    force: Float[AnyArray, " points"]
    columns: Float[AnyArray, "points n"]
    values: Float[AnyArray, " rows"]
    rows: Float[AnyArray, "rows n"]


class Report(NamedTuple):
    """Quantities of a fit for the report.

    Attributes:
        numbers: all numbers of the model, shape (l,).
        d_numbers: their derivatives in parameters and coefficients, shape (l, q + n).
        derived: derived quantities, shape (d,).
        d_derived: their derivatives in the parameters of the family, shape (d, q).
        path_modulus: Drucker modulus along the paths [Pa], shape (paths, stations); nan without a bladder.
        slope: tangent modulus [Pa] at the same fractions of the largest strain, same shape.
        largest_strain: largest strain magnitude [-] of each path, shape (paths,).
        rest: rest length L0 [m], at which every path starts, shape ().
        path_end: length [m] at which each path ends, shape (paths,).
    """

    numbers: Float[AnyArray, " l"]
    d_numbers: Float[AnyArray, "l unknowns"]
    derived: Float[AnyArray, " d"]
    d_derived: Float[AnyArray, "d q"]
    path_modulus: Float[AnyArray, "paths stations"]
    slope: Float[AnyArray, "paths stations"]
    largest_strain: Float[AnyArray, " paths"]
    rest: Float[AnyArray, ""]
    path_end: Float[AnyArray, " paths"]


def linear_response(
    family: AbstractFamily,
    constraint: Constraint,
    at: MapInputs,
    p: Float[AnyArray, " q"],
    x0: Float[AnyArray, " n"],
    reached: Float[AnyArray, " points"],
    to_x: Float[AnyArray, "own n"] | None = None,
) -> Linear:
    """Linearise the response about (p, x0).

    Args:
        family: family of models.
        constraint: constraint on the coefficients.
        at: readings and paths.
        p: values of `family.nonlinear`.
        x0: values of `family.linear`, or the vector from which `to_x` computes them.
        reached: force [N] at the readings that deflects a compliant rig.
        to_x: matrix from x0 to `family.linear`; None if x0 holds these values.
    """
    placed = _Placed.of(family, at, p, reached)

    def made(x: Float[Array, " n"]) -> Float[Array, " own"]:
        return x if to_x is None else to_x @ x

    def of_coefficients(own: Float[Array, " own"]) -> tuple[Array, Array]:
        model = placed.model(own)
        values = _Paths.of(model, placed.rest, placed.end, at).constraint(model, constraint)
        return model.force(placed.length, placed.pressure), values.ravel()

    # Strains are the same for all coefficients: they are traced once.
    (force, values), slope = jax.linearize(of_coefficients, made(x0))
    if x0.shape[0]:
        directions = jnp.eye(x0.shape[0]) if to_x is None else to_x.T
        columns, rows = jax.vmap(slope, out_axes=-1)(directions)
    else:
        columns, rows = jnp.zeros((*force.shape, 0)), jnp.zeros((*values.shape, 0))
    force, values = force - columns @ x0, values - rows @ x0
    if placed.rig is not None:
        gain = jax.lax.stop_gradient(
            _gain(placed.model(made(x0)), placed.length, placed.pressure, reached, placed.rig)[1]
        )
        force, columns = reached + gain * (force - reached), gain[:, None] * columns
    return Linear(force, columns, values, rows)


def report(
    family: AbstractFamily,
    at: MapInputs,
    p: Float[AnyArray, " q"],
    x: Float[AnyArray, " n"],
    reached: Float[AnyArray, " points"],
) -> Report:
    """Quantities for the report at (p, x); see `linear_response` for the arguments."""
    placed = _Placed.of(family, at, p, reached)
    model = placed.model(x)
    paths = _Paths.of(model, placed.rest, placed.end, at)

    def derived(p: Float[Array, " q"]) -> Float[Array, " d"]:
        found = family.derived(dict(zip(family.nonlinear, p, strict=True)))
        return jnp.stack(found) if found else jnp.zeros(0)

    def numbers(unknowns: Float[Array, " unknowns"]) -> Float[Array, " l"]:
        values = dict(zip(family.nonlinear, unknowns[: len(family.nonlinear)], strict=True))
        linear = dict(zip(family.linear, unknowns[len(p) :], strict=True))
        return flat(family.build({**values, **linear}))

    both = jnp.concatenate([p, x])
    return Report(
        numbers=flat(model),
        d_numbers=jax.jacfwd(numbers)(both) if both.size else jnp.zeros((flat(model).size, 0)),
        derived=derived(p),
        d_derived=jax.jacfwd(derived)(p) if p.size else jnp.zeros((0, 0)),
        path_modulus=paths.modulus(model),
        slope=paths.slope(model),
        largest_strain=paths.largest,
        rest=jnp.asarray(placed.rest, float),
        path_end=placed.end,
    )


class _Placed(NamedTuple):
    """Models at given parameters, with readings corrected for the rig and ends of paths."""

    family: AbstractFamily
    searched: dict[str, Array]
    length: Float[Array, " points"]
    pressure: Float[Array, " points"]
    rig: tuple[Array, Array | None] | None
    rest: Float[Array, ""]
    end: Float[Array, " paths"]

    @classmethod
    def of(
        cls,
        family: AbstractFamily,
        at: MapInputs,
        p: Float[Array, " q"],
        reached: Float[Array, " points"],
    ) -> "_Placed":
        searched = dict(zip(family.nonlinear, p, strict=True))
        rig = rig_of(searched)
        length, end = jnp.asarray(at.length), jnp.asarray(at.path_end)
        if rig is not None:
            end = jnp.minimum(end, jnp.min(length - famjax.muscle.give_way(at.force, *rig)))
            length = length - famjax.muscle.give_way(reached, *rig)
        rest = jnp.asarray(family.rest_length(searched))
        return cls(family, searched, length, jnp.asarray(at.pressure), rig, rest, end)

    def model(self, x: Float[Array, " n"]) -> Any:
        """Build the model with these coefficients."""
        return self.family.build({**self.searched, **dict(zip(self.family.linear, x, strict=True))})


def force_and_constraint(
    family: AbstractFamily,
    constraint: Constraint,
    at: MapInputs,
    p: Float[Array, " q"],
    x: Float[Array, " n"],
    compliant_steps: int = 0,
) -> tuple[Float[Array, " points"], Float[Array, " rows"]]:
    """Force in the rig [N] and values of the constraint [Pa], without linearisation.

    Args:
        family: family of models.
        constraint: constraint on the coefficients.
        at: readings and paths.
        p: values of `family.nonlinear`.
        x: coefficients.
        compliant_steps: Newton steps for the force in a compliant rig, starting at `at.force`. At the
            solution, two steps give exact first and second derivatives.
    """
    force = jnp.asarray(at.force)
    placed = _Placed.of(family, at, p, force)
    model = placed.model(x)
    if placed.rig is None:
        force = model.force(placed.length, placed.pressure)
    else:
        for _ in range(compliant_steps):
            length = at.length - famjax.muscle.give_way(force, *placed.rig)
            muscle, gain = _gain(model, length, placed.pressure, force, placed.rig)
            force = force + gain * (muscle - force)
    paths = _Paths.of(model, placed.rest, placed.end, at)
    return force, paths.constraint(model, constraint).ravel()


def rig_of(values: Mapping[str, Array]) -> tuple[Array, Array | None] | None:
    """Compliance and exponent of the rig; None for a rigid rig."""
    compliance = values.get("series_compliance")
    return None if compliance is None else (compliance, values.get("series_exponent"))


def _gain(
    model: Any, length: Array, pressure: Array, reached: Array, rig: tuple[Array, Array | None]
) -> tuple[Array, Array]:
    """Force [N] of the muscle, and the factor 1 / (1 + rig compliance x muscle stiffness).

    Args:
        model: model of the muscle.
        length: length of the muscle [m].
        pressure: gauge pressure [Pa].
        reached: force [N] that deflects the rig.
        rig: see `rig_of`.
    """
    ones = jnp.ones_like(length)
    force, stiffness = jax.jvp(lambda L: model.force(L, pressure), (length,), (ones,))
    softness = jax.jvp(lambda F: famjax.muscle.give_way(F, *rig), (reached,), (ones,))[1]
    return force, 1 / (1 + softness * stiffness)


def flat(model: Any) -> Float[Array, " l"]:
    """All numbers of a model as one vector."""
    leaves = jax.tree.leaves(eqx.filter(model, eqx.is_inexact_array))
    return jnp.concatenate([leaf.ravel() for leaf in leaves])


def unflat(family: AbstractFamily, numbers: Float[np.ndarray, " l"]) -> Any:
    """Rebuild a model from the vector of its numbers; nothing is compiled."""
    names = dict.fromkeys((*family.nonlinear, *family.linear), jax.ShapeDtypeStruct((), float))
    shape = eqx.filter_eval_shape(family.build, names)
    leaves, treedef = jax.tree.flatten(shape)
    found, first = [], 0
    for leaf in leaves:
        if isinstance(leaf, jax.ShapeDtypeStruct) and jnp.issubdtype(leaf.dtype, jnp.inexact):
            size = math.prod(leaf.shape)
            found.append(jax.device_put(numbers[first : first + size].reshape(leaf.shape).copy()))
            first += size
        else:
            found.append(leaf)
    return jax.tree.unflatten(treedef, found)


class _Paths(eqx.Module):
    """Actuation paths: strains at the stations, and the largest strain."""

    strains: famjax.stability.PathStrains | None
    pressure: Float[Array, " paths"]
    shares: Float[Array, "paths stations"]
    largest: Float[Array, " paths"]

    @classmethod
    def of(
        cls, model: Any, rest: Float[Array, ""], end: Float[Array, " paths"], at: MapInputs
    ) -> "_Paths":
        shares, pressure = jnp.asarray(at.stations), jnp.asarray(at.path_pressure)
        if bladder_of(model) is None or not shares.shape[1]:
            return cls(None, pressure, shares, jnp.zeros(pressure.shape))
        ends = jnp.stack([jnp.broadcast_to(rest, end.shape), end], axis=-1)
        lengths = rest + shares * (end - rest)[:, None]
        # One evaluation serves the stations and both ends.
        both = famjax.stability.path_strains(
            model.geometry, jnp.concatenate([lengths, ends], axis=-1), pressure[:, None]
        )
        size = jnp.maximum(
            jnp.max(jnp.abs(both.hoop[:, -2:]), axis=-1), jnp.max(jnp.abs(both.axial[:, -2:]), -1)
        )
        strains = jax.tree.map(lambda leaf: leaf[:, :-2], both)
        return cls(strains, pressure, shares, jnp.max(size, axis=-1))

    def constraint(self, model: Any, constraint: Constraint) -> Float[Array, "paths stations"]:
        if constraint == "drucker":
            return self.modulus(model)
        if constraint == "slope":
            return self.slope(model)
        return jnp.zeros((self.shares.shape[0], 0))

    def modulus(self, model: Any) -> Float[Array, "paths stations"]:
        if self.strains is None:
            return jnp.full(self.shares.shape, jnp.nan)
        return self.strains.modulus(model.material)

    def slope(self, model: Any) -> Float[Array, "paths stations"]:
        material = bladder_of(model)
        if material is None or material.directions_interact:
            return jnp.full(self.shares.shape, jnp.nan)
        strain = self.shares * self.largest[:, None]
        return jax.jvp(
            lambda e: material.stresses(e, e, self.pressure[:, None])[0],
            (strain,),
            (jnp.ones_like(strain),),
        )[1]


def bladder_of(model: Any) -> famjax.materials.AbstractMaterial | None:
    """Bladder law of a model with a geometry; None if it has none."""
    if getattr(model, "geometry", None) is None:
        return None
    return getattr(model, "material", None)
