"""What a fit asks of a model: force, columns and rows of constraints, with their derivatives."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

import famjax

from .family import AbstractFamily

_T = TypeVar("_T")
_A = TypeVar("_A")
Constraint = Literal["none", "positive", "slope", "drucker"]
PressureDependence = Literal["fixed", "linear", "free"]

CONSTRAINTS: tuple[Constraint, ...] = ("none", "positive", "slope", "drucker")
DEPENDENCES: tuple[PressureDependence, ...] = ("fixed", "linear", "free")


STATIONS = 57
"""Stations of each actuation path: 49 from the start and 8 for points found between them."""


class MapInputs(eqx.Module):
    """Where a model is evaluated: at readings and along actuation paths.

    Attributes:
        length, pressure, force: of the readings [m, Pa, N], shape (points,).
        length_index: number of each reading's length among those that have an offset, (points,).
        path_pressure: of the paths [Pa], shape (paths,).
        path_end: shortest length [m] of each path, shape (paths,); all start at rest.
        stations: parts of the path in [0, 1], shape (paths, stations).
    """

    length: Float[np.ndarray, " points"]
    pressure: Float[np.ndarray, " points"]
    force: Float[np.ndarray, " points"]
    length_index: Int[np.ndarray, " points"]
    path_pressure: Float[np.ndarray, " paths"]
    path_end: Float[np.ndarray, " paths"]
    stations: Float[np.ndarray, "paths stations"]


class Response(NamedTuple):
    """The linear model at a point; its derivatives in the parameters have the same form.

    Attributes:
        force: of the muscle [N] at x0, shape (points,).
        columns: its derivative in the coefficients, shape (points, n).
        values: of the constraint along the paths [Pa] at x0, shape (paths, stations).
        rows: their derivative in the coefficients, shape (paths, stations, n).
        derived: what follows from the parameters, shape (d,).
        numbers: all numbers of the model at x0, one after another, shape (l,).
        number_columns: their derivative in the coefficients, shape (l, n).
    """

    force: Float[Array, " points"]
    columns: Float[Array, "points n"]
    values: Float[Array, "paths stations"]
    rows: Float[Array, "paths stations n"]
    derived: Float[Array, " d"]
    numbers: Float[Array, " l"]
    number_columns: Float[Array, "l n"]


class Aside(NamedTuple):
    """What needs no derivative.

    Attributes:
        gain: 1/(1 + delta' dF/dL) at the readings, how far a compliant rig lets the force move when
            the muscle's own does; 1 in a rigid one, shape (points,).
        path_modulus: along the paths [Pa] at x0, shape (paths, stations); nan without a bladder.
        slope: tangent modulus [Pa] at the same shares of the largest strain, same shape.
        largest_strain: magnitude [-] along each path, shape (paths,).
        strains: along the axis, then around it at each station of the muscle [-], along the paths,
            shape (paths, stations, strains).
        rest: L0 [m], where every path starts, shape ().
        path_end: where each path ends [m], shape (paths,).
    """

    gain: Float[Array, " points"]
    path_modulus: Float[Array, "paths stations"]
    slope: Float[Array, "paths stations"]
    largest_strain: Float[Array, " paths"]
    strains: Float[Array, "paths stations strains"]
    rest: Float[Array, ""]
    path_end: Float[Array, " paths"]


def bucket(count: int, least: int = 8) -> int:
    """The size to which a shape is padded: a power of two."""
    return max(least, 2 ** math.ceil(math.log2(count)))


def response(
    family: AbstractFamily,
    constraint: Constraint,
    at: MapInputs,
    p: Float[Array, " q"] | Sequence[Array],
    x0: Float[Array, " n"],
    reached: Float[Array, " points"],
) -> tuple[Response, Aside]:
    """The linear model at (p, x0), as traced code; both drivers of a fit are made of it.

    Args:
        family: what is fitted.
        constraint: on the coefficients.
        at: readings and paths.
        p: `family.nonlinear`, then one offset for each length that has one; in one array or in
            several.
        x0: `family.linear`.
        reached: force [N] at the readings, by which a compliant rig gives way.
    """
    known = len(family.nonlinear)
    searched = dict(zip(family.nonlinear, p[:known], strict=True))
    rig = rig_of(searched)
    length, pressure = jnp.asarray(at.length), jnp.asarray(at.pressure)
    if len(p) > known:
        length = length + jnp.stack(list(p[known:]))[at.length_index]
    rest, end = family.rest_length(searched), jnp.asarray(at.path_end)
    if rig is not None:
        end = jnp.minimum(end, jnp.min(length - famjax.muscle.give_way(at.force, *rig)))
        length = length - famjax.muscle.give_way(reached, *rig)
    middle = family.build({**searched, **dict(zip(family.linear, x0, strict=True))})
    paths = _Paths.of(middle, rest, end, at)

    def of_coefficients(x: Float[Array, " n"]) -> tuple[Array, Array, Array]:
        model = family.build({**searched, **dict(zip(family.linear, x, strict=True))})
        return model.force(length, pressure), paths.constraint(model, constraint), flat(model)

    if x0.shape[0]:
        (force, values, numbers), slopes, _ = with_derivatives(
            lambda x: (of_coefficients(x), None), x0
        )
        columns, rows, number_columns = (jnp.moveaxis(slope, 0, -1) for slope in slopes)
    else:
        force, values, numbers = of_coefficients(x0)
        columns, rows, number_columns = (v[..., None][..., :0] for v in (force, values, numbers))
    derived = family.derived(searched)
    aside = Aside(
        gain=jnp.ones_like(force)
        if rig is None
        else _gain(middle, length, pressure, reached, rig)[1],
        path_modulus=values if constraint == "drucker" else paths.modulus(middle),
        slope=values if constraint == "slope" else paths.slope(middle),
        largest_strain=paths.largest,
        strains=paths.in_all_directions(),
        rest=jnp.asarray(rest, float),
        path_end=end,
    )
    scalars = jnp.stack(derived) if derived else jnp.zeros(0)
    return Response(force, columns, values, rows, scalars, numbers, number_columns), aside


def with_derivatives(
    function: Callable[[Array], tuple[_T, _A]], x: Float[Array, " n"]
) -> tuple[_T, _T, _A]:
    """What a function returns, the derivatives of the first of it, and the second as it is.

    Values and derivatives are traced in one pass, by less than half the work of `jax.linearize`
    with a map of what it returns.

    Returns:
        The first, its derivatives along a new leading axis, and the second.
    """
    return jax.vmap(
        lambda e: jax.jvp(function, (x,), (e,), has_aux=True), out_axes=(None, 0, None)
    )(jnp.eye(x.shape[0]))


def force_and_constraint(
    family: AbstractFamily,
    constraint: Constraint,
    at: MapInputs,
    p: Float[Array, " q"],
    x: Float[Array, " n"],
    compliant_steps: int = 0,
) -> tuple[Float[Array, " points"], Float[Array, " rows"]]:
    """What the rig measures [N] and the constraint's values [Pa], with nothing made linear.

    Args:
        family: what is fitted.
        constraint: on the coefficients.
        at: readings and paths.
        p: `family.nonlinear`, then one offset for each length that has one.
        x: coefficients.
        compliant_steps: Newton steps for the force in a compliant rig, from `at.force`; two at the
            solution have its first and second derivatives.
    """
    known = len(family.nonlinear)
    searched = dict(zip(family.nonlinear, p[:known], strict=True))
    model = family.build({**searched, **dict(zip(family.linear, x, strict=True))})
    length, pressure = jnp.asarray(at.length), jnp.asarray(at.pressure)
    if p.shape[0] > known:
        length = length + p[known:][at.length_index]
    rest, end = family.rest_length(searched), jnp.asarray(at.path_end)
    rig = rig_of(searched)
    if rig is None:
        force = model.force(length, pressure)
    else:
        end = jnp.minimum(end, jnp.min(length - famjax.muscle.give_way(at.force, *rig)))
        force = jnp.asarray(at.force)
        for _ in range(compliant_steps):
            shortened = length - famjax.muscle.give_way(force, *rig)
            muscle, gain = _gain(model, shortened, pressure, force, rig)
            force = force + gain * (muscle - force)
    paths = _Paths.of(model, rest, end, at)
    return force, paths.constraint(model, constraint).ravel()


def rig_of(values: Mapping[str, Array]) -> tuple[Array, Array | None] | None:
    """Compliance and exponent of the rig among named numbers, None for a rigid one."""
    compliance = values.get("series_compliance")
    return None if compliance is None else (compliance, values.get("series_exponent"))


def _gain(
    model: Any, length: Array, pressure: Array, reached: Array, rig: tuple[Array, Array | None]
) -> tuple[Array, Array]:
    """The muscle's own force [N], and how far the rig lets the force move when it does, see `Aside`.

    Args:
        model: of the muscle.
        length: its own [m].
        pressure: gauge [Pa].
        reached: force [N] by which the rig gives way.
        rig: see `rig_of`.
    """
    ones = jnp.ones_like(length)
    force, stiffness = jax.jvp(lambda L: model.force(L, pressure), (length,), (ones,))
    softness = jax.jvp(lambda F: famjax.muscle.give_way(F, *rig), (reached,), (ones,))[1]
    return force, 1 / (1 + softness * stiffness)


def flat(model: Any) -> Float[Array, " l"]:
    """All numbers of a model, leaf by leaf."""
    leaves = jax.tree.leaves(eqx.filter(model, eqx.is_inexact_array))
    return jnp.concatenate([leaf.ravel() for leaf in leaves])


def unflat(family: AbstractFamily, numbers: Float[np.ndarray, " l"]) -> Any:
    """The model of a family whose numbers these are; nothing is compiled."""
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
    """Actuation paths of a geometry: strains at the stations, and the largest strain."""

    strains: famjax.materials.PathStrains | None
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
        both = famjax.materials.path_strains(
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

    def in_all_directions(self) -> Float[Array, "paths stations strains"]:
        if self.strains is None:
            return jnp.zeros((*self.shares.shape, 0))
        return jnp.concatenate([self.strains.axial[..., :1], self.strains.hoop], axis=-1)

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
    """The bladder's law of a model that has one and a geometry; None of one that has not."""
    if getattr(model, "geometry", None) is None:
        return None
    return getattr(model, "material", None)
