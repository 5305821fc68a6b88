"""The one compiled program of a fit: a model's force and constraint, linear in its coefficients.

At nonlinear parameters p and coefficients x0 it gives

    F(x) = force + columns (x - x0),   g(x) = rows (x - x0) + values >= 0,

with the derivatives of all of these in p. Everything else of a fit happens on the host. The program
depends on the structure of the family and on the shapes of its inputs, which are padded to buckets:
another map, specimen or bound is another input.
"""

import copy
import functools
import math
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

import famjax
from famjax.compile_options import quick_options

from .family import AbstractFamily

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


class Response(eqx.Module):
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


class Aside(eqx.Module):
    """What needs no derivative.

    Attributes:
        stiffness: dF/dL [N/m] of the muscle at the readings, shape (points,).
        path_modulus: along the paths [Pa] at x0, shape (paths, stations); nan without a bladder.
        slope: tangent modulus [Pa] at the same shares of the largest strain, same shape.
        largest_strain: magnitude [-] along each path, shape (paths,).
        rest: L0 [m], where every path starts, shape ().
        path_end: where each path ends [m], shape (paths,).
    """

    stiffness: Float[Array, " points"]
    path_modulus: Float[Array, "paths stations"]
    slope: Float[Array, "paths stations"]
    largest_strain: Float[Array, " paths"]
    rest: Float[Array, ""]
    path_end: Float[Array, " paths"]


def bucket(count: int, least: int = 8) -> int:
    """The size to which a shape is padded: a power of two."""
    return max(least, 2 ** math.ceil(math.log2(count)))


def response(
    family: AbstractFamily,
    constraint: Constraint,
    at: MapInputs,
    p: Float[Array, " q"],
    x0: Float[Array, " n"],
    reached: Float[Array, " points"],
) -> tuple[Response, Aside]:
    """The linear model at (p, x0), as traced code; both drivers of a fit are made of it.

    Args:
        family: what is fitted.
        constraint: on the coefficients.
        at: readings and paths.
        p: `family.nonlinear`, then one offset for each length that has one.
        x0: `family.linear`.
        reached: force [N] at the readings, by which a compliant rig gives way.
    """
    known = len(family.nonlinear)
    searched = dict(zip(family.nonlinear, p[:known], strict=True))
    compliance = searched.get("series_compliance")
    length, pressure = jnp.asarray(at.length), jnp.asarray(at.pressure)
    if p.shape[0] > known:
        length = length + p[known:][at.length_index]
    rest, end = family.rest_length(searched), jnp.asarray(at.path_end)
    if compliance is not None:
        end = jnp.minimum(end, jnp.min(length - compliance * at.force))
        length = length - compliance * reached
    middle = family.build({**searched, **dict(zip(family.linear, x0, strict=True))})
    paths = _Paths.of(middle, rest, end, at)

    def of_coefficients(x: Float[Array, " n"]) -> tuple[Array, Array, Array]:
        model = family.build({**searched, **dict(zip(family.linear, x, strict=True))})
        return model.force(length, pressure), paths.constraint(model, constraint), flat(model)

    (force, values, numbers), slopes = jax.linearize(of_coefficients, x0)
    if x0.shape[0]:
        columns, rows, number_columns = jax.vmap(slopes, out_axes=-1)(jnp.eye(x0.shape[0]))
    else:
        columns, rows, number_columns = (v[..., None][..., :0] for v in (force, values, numbers))
    derived = family.derived(searched)
    stiffness = jnp.zeros_like(force)
    if compliance is not None:
        stiffness = jax.jvp(
            lambda L: middle.force(L, pressure), (length,), (jnp.ones_like(length),)
        )[1]
    aside = Aside(
        stiffness=stiffness,
        path_modulus=paths.modulus(middle),
        slope=paths.slope(middle),
        largest_strain=paths.largest,
        rest=jnp.asarray(rest, float),
        path_end=end,
    )
    told = jnp.stack(derived) if derived else jnp.zeros(0)
    return Response(force, columns, values, rows, told, numbers, number_columns), aside


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
    compliance = searched.get("series_compliance")
    if compliance is None:
        force = model.force(length, pressure)
    else:
        end = jnp.minimum(end, jnp.min(length - compliance * at.force))
        force = jnp.asarray(at.force)
        for _ in range(compliant_steps):
            muscle, stiffness = jax.jvp(
                lambda L: model.force(L, pressure),
                (length - compliance * force,),
                (jnp.ones_like(length),),
            )
            force = force + (muscle - force) / (1 + compliance * stiffness)
    paths = _Paths.of(model, rest, end, at)
    return force, paths.constraint(model, constraint).ravel()


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
            found.append(jnp.asarray(np.reshape(numbers[first : first + size], leaf.shape)))
            first += size
        else:
            found.append(leaf)
    return jax.tree.unflatten(treedef, found)


class _Paths(eqx.Module):
    """Actuation paths of a geometry: strains at the stations, and the largest strain."""

    strains: famjax.PathStrains | None
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
        both = famjax.path_strains(
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


def bladder_of(model: Any) -> famjax.AbstractMaterial | None:
    """The bladder's law of a model that has one and a geometry; None of one that has not."""
    if getattr(model, "geometry", None) is None:
        return None
    return getattr(model, "material", None)


class _Compiled:
    """The jitted program of one structure; JAX keeps an executable for each shape.

    All results come as one vector: unpacking it on the host is cheaper than twenty transfers.
    """

    def __init__(self, treedef: Any, static: tuple, constraint: Constraint) -> None:
        self._layouts: dict[tuple[int, ...], tuple[Any, list[tuple[int, ...]]]] = {}
        self._static, self._treedef, self._constraint = static, treedef, constraint
        self._jitted = jax.jit(self._packed, compiler_options=quick_options())

    def __call__(
        self, arrays: list[Array | None], p: np.ndarray, x0: np.ndarray, reached: np.ndarray
    ) -> tuple[Response, Response, Aside]:
        packed = np.asarray(self._jitted(arrays, p, x0, reached))
        treedef, shapes = self._layouts[_sizes(arrays, p, x0, reached)]
        leaves, first = [], 0
        for shape in shapes:
            size = math.prod(shape)
            leaves.append(packed[first : first + size].reshape(shape))
            first += size
        return jax.tree.unflatten(treedef, leaves)

    def _packed(self, arrays: list[Array | None], p: Array, x0: Array, reached: Array) -> Array:
        leaves = [s if a is None else a for a, s in zip(arrays, self._static, strict=True)]
        family, at = jax.tree.unflatten(self._treedef, leaves)

        def of_parameters(p: Array) -> tuple[Response, Aside]:
            return response(family, self._constraint, at, p, x0, reached)

        value, slopes, aside = jax.linearize(of_parameters, p, has_aux=True)
        found = value, jax.vmap(slopes)(jnp.eye(p.shape[0])), aside
        parts, treedef = jax.tree.flatten(found)
        self._layouts[_sizes(arrays, p, x0, reached)] = treedef, [part.shape for part in parts]
        return jnp.concatenate([part.ravel() for part in parts])


def _sizes(arrays: list[Array | None], *more: Array | np.ndarray) -> tuple[int, ...]:
    return tuple(a.size for a in (*arrays, *more) if a is not None)


@functools.lru_cache(maxsize=256)
def _compiled(treedef: Any, static: tuple, constraint: Constraint) -> _Compiled:
    return _Compiled(treedef, static, constraint)


class Program:
    """The linear model of a family at the readings and paths of one map, compiled."""

    def __init__(self, family: AbstractFamily, constraint: Constraint, at: MapInputs) -> None:
        self._points, padded = at.length.size, _padded(at)
        self._size = padded.length.size
        leaves, treedef = jax.tree.flatten((family, padded))
        arrays = [np.asarray(leaf) if eqx.is_array_like(leaf) else None for leaf in leaves]
        static = tuple(leaf if a is None else None for a, leaf in zip(arrays, leaves, strict=True))
        self._evaluate = _compiled(treedef, static, constraint)
        self._arrays = [None if a is None else jnp.asarray(a) for a in arrays]

    def at(self, inputs: MapInputs) -> "Program":
        """The same program at other readings and paths of the same sizes; nothing is compiled."""
        other = copy.copy(self)
        other._points = inputs.length.size
        own = [jnp.asarray(leaf) for leaf in jax.tree.leaves(_padded(inputs, self._size))]
        other._arrays = [*self._arrays[: len(self._arrays) - len(own)], *own]
        return other

    @property
    def size(self) -> int:
        """Number of readings that one call takes."""
        return self._size

    def __call__(
        self,
        p: Float[np.ndarray, " q"],
        x0: Float[np.ndarray, " n"],
        reached: Float[np.ndarray, " points"],
    ) -> tuple[Response, Response, Aside]:
        """Values, derivatives in p (leading axis of parameters), and what has none."""
        force = np.zeros(self._size)
        force[: self._points] = reached
        return self._evaluate(self._arrays, p, x0, force)


def _padded(at: MapInputs, size: int | None = None) -> MapInputs:
    """The same inputs, the last reading and path repeated up to the size of the bucket."""
    extra = (size or bucket(at.length.size, 64)) - at.length.size
    paths = at.path_end.size
    more = 0 if paths <= 2 else bucket(paths, 4) - paths

    def longer(values: np.ndarray, by: int) -> np.ndarray:
        return np.concatenate([values, np.repeat(values[-1:], by, axis=0)]) if by else values

    readings = (at.length, at.pressure, at.force, at.length_index)
    return MapInputs(
        *(longer(v, extra) for v in readings),
        *(longer(v, more) for v in (at.path_pressure, at.path_end, at.stations)),
    )
