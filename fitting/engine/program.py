"""The one program of a fit: a model's force and constraint, linear in its coefficients.

At nonlinear parameters p and coefficients x0 it gives

    F(x) = force + columns (x - x0),   g(x) = rows (x - x0) + values >= 0,

with the derivatives of all of these in p, for several members at once. Everything else of a fit
happens on the host. The program depends on the structure of the family and on the shapes of its
inputs, which are padded to buckets: another map, specimen or bound is another input.
"""

import copy
import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

import famjax
from famjax.compile_options import quick_options

from ..trace import tape_store
from ..trace.tape import UnknownPrimitiveError, record
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

    if x0.shape[0]:
        (force, values, numbers), slopes, _ = with_derivatives(
            lambda x: (of_coefficients(x), None), x0
        )
        columns, rows, number_columns = (jnp.moveaxis(slope, 0, -1) for slope in slopes)
    else:
        force, values, numbers = of_coefficients(x0)
        columns, rows, number_columns = (v[..., None][..., :0] for v in (force, values, numbers))
    derived = family.derived(searched)
    stiffness = jnp.zeros_like(force)
    if compliance is not None:
        stiffness = jax.jvp(
            lambda L: middle.force(L, pressure), (length,), (jnp.ones_like(length),)
        )[1]
    aside = Aside(
        stiffness=stiffness,
        path_modulus=values if constraint == "drucker" else paths.modulus(middle),
        slope=values if constraint == "slope" else paths.slope(middle),
        largest_strain=paths.largest,
        rest=jnp.asarray(rest, float),
        path_end=end,
    )
    told = jnp.stack(derived) if derived else jnp.zeros(0)
    return Response(force, columns, values, rows, told, numbers, number_columns), aside


def with_derivatives(
    function: Callable[[Array], tuple[_T, _A]], x: Float[Array, " n"]
) -> tuple[_T, _T, _A]:
    """What a function returns, the derivatives of the first of it, and the second as it is.

    Values and derivatives are traced in one pass, by less than half the work of `jax.linearize`
    with a map of what it returns.

    Args:
        function: returns what is differentiated, and what is not.
        x: where.

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


_FIELDS = (*Response._fields, *Response._fields, *Aside._fields)
_OF_DESCENTS = frozenset({"force", "columns", "values", "rows", "stiffness"})
_ALL = frozenset(_FIELDS)
_MEMBERS = 16
"""Members that a compiled program evaluates at once."""


class _Traced:
    """The program of one structure and size, with the members of a batch along a last axis.

    It is done in NumPy; with an operation that has no rule there it is compiled.
    """

    def __init__(
        self,
        function: Callable[..., tuple[Response, Response, Aside]],
        examples: tuple[Any, ...],
        key: str | None,
    ) -> None:
        def leaves(*arguments: Any) -> list[Array]:
            return jax.tree.leaves(function(*arguments))

        def packed(*arguments: Any) -> Array:
            return jnp.concatenate([leaf.ravel() for leaf in leaves(*arguments)])

        self._runs: dict[tuple[int, ...], Callable[..., list[np.ndarray]]] = {}
        self._tape = tape_store.load(key)
        if self._tape is not None:
            return
        try:
            self._tape = record(leaves, *examples)
            tape_store.save(key, self._tape)
        except UnknownPrimitiveError:
            self._shapes = [leaf.shape for leaf in jax.eval_shape(leaves, *examples)]
            self._compiled = jax.jit(
                jax.vmap(packed, in_axes=(None, 0, 0, 0)), compiler_options=quick_options()
            )

    def __call__(
        self, arrays: list[np.ndarray], varying: tuple[np.ndarray, ...], fields: frozenset[str]
    ) -> tuple[Response, Response, Aside]:
        """Members along the first axis, of arguments and of results; what is not asked is None."""
        if self._tape is None:
            found: list[Any] = self._compiled_leaves(arrays, varying)
        else:
            found, members = [None] * len(_FIELDS), max(len(v) for v in varying)
            places = tuple(k for k, name in enumerate(_FIELDS) if name in fields)
            values = self._on_tape([array[..., None] for array in arrays], varying, places)
            for place, value in zip(places, values, strict=True):
                of_each = np.broadcast_to(value, (*value.shape[:-1], members))
                found[place] = np.ascontiguousarray(np.moveaxis(of_each, -1, 0))
        split = len(Response._fields)
        return (
            Response(*found[:split]), Response(*found[split : 2 * split]), Aside(*found[2 * split :])
        )  # fmt: skip

    def forces(
        self, arrays: list[np.ndarray], varying: tuple[np.ndarray, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Force and stiffness alone, each of shape (members, points).

        Args:
            arrays: of the family and the inputs, with members along a last axis, which may be one.
            varying: p, x0 and the forces reached, with members along the first axis.
        """
        places = _FIELDS.index("force"), _FIELDS.index("stiffness")
        members = len(varying[-1])
        if self._tape is not None:
            found = self._on_tape(arrays, varying, places)
            shape = (varying[-1].shape[1], members)
            force, stiffness = (np.broadcast_to(value, shape).T for value in found)
            return force, stiffness
        singles = [
            self._compiled_leaves([a[..., min(k, a.shape[-1] - 1)] for a in arrays],
                                  (varying[0], varying[1], varying[2][k : k + 1]))
            for k in range(members)
        ]  # fmt: skip
        force, stiffness = (np.concatenate([one[place] for one in singles]) for place in places)
        return force, stiffness

    def _on_tape(
        self, arrays: list[np.ndarray], varying: tuple[np.ndarray, ...], places: tuple[int, ...]
    ) -> list[np.ndarray]:
        assert self._tape is not None
        if places not in self._runs:
            self._runs[places] = self._tape.function(list(places))
        return self._runs[places](*arrays, *(np.moveaxis(v, 0, -1) for v in varying))

    def _compiled_leaves(
        self, arrays: list[np.ndarray], varying: tuple[np.ndarray, ...]
    ) -> list[np.ndarray]:
        members = max(len(v) for v in varying)
        size = -(-members // _MEMBERS) * _MEMBERS
        rows = np.minimum(np.arange(size), members - 1)
        padded = [v[rows] if len(v) > 1 else np.repeat(v, size, axis=0) for v in varying]
        packed = np.concatenate(
            [
                np.asarray(self._compiled(arrays, *(v[k : k + _MEMBERS] for v in padded)))
                for k in range(0, size, _MEMBERS)
            ]
        )[:members]
        ends = np.cumsum([math.prod(shape) for shape in self._shapes])
        parts = np.split(packed, ends[:-1], axis=1)
        return [
            part.reshape(members, *shape) for part, shape in zip(parts, self._shapes, strict=True)
        ]


@functools.lru_cache(maxsize=256)
def _traced(
    treedef: Any, static: tuple, constraint: Constraint, shapes: tuple[tuple[tuple[int, ...], str], ...],
    sizes: tuple[int, int, int], family_key: str | None,
) -> _Traced:  # fmt: skip
    def function(
        arrays: list[Array], p: Array, x0: Array, reached: Array
    ) -> tuple[Response, Response, Aside]:
        given = iter(arrays)
        leaves = [next(given) if kept is None else kept[0] for kept in static]
        family, at = jax.tree.unflatten(treedef, leaves)

        def of_parameters(p: Array) -> tuple[Response, Aside]:
            return response(family, constraint, at, p, x0, reached)

        return with_derivatives(of_parameters, p)

    def array(shape: tuple[int, ...], kind: str = "f8") -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(shape, np.dtype(kind))

    arrays = [array(shape, kind) for shape, kind in shapes]
    key = None if family_key is None else tape_store.identity(family_key, constraint, shapes, sizes)
    return _Traced(function, (arrays, *(array((size,)) for size in sizes)), key)


class Program:
    """The linear model of a family at the readings and paths of one map."""

    def __init__(self, family: AbstractFamily, constraint: Constraint, at: MapInputs) -> None:
        self._points, padded = at.length.size, _padded(at)
        self._size = padded.length.size
        leaves, treedef = jax.tree.flatten((family, padded))
        self._arrays = [np.asarray(leaf) for leaf in leaves if eqx.is_array_like(leaf)]
        static = tuple(None if eqx.is_array_like(leaf) else (leaf,) for leaf in leaves)
        self._key = treedef, static, constraint, tuple((a.shape, a.dtype.str) for a in self._arrays)
        self._family_key = tape_store.identity(family.identity)

    def at(self, inputs: MapInputs) -> "Program":
        """The same program at other readings and paths of the same sizes; nothing is traced."""
        other = copy.copy(self)
        other._points = inputs.length.size
        own = [np.asarray(leaf) for leaf in jax.tree.leaves(_padded(inputs, self._size))]
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
        found = self.of_members(p[None], x0[None], reached[None], complete=True)
        return jax.tree.map(lambda leaf: leaf[0], found)

    def of_members(
        self,
        p: Float[np.ndarray, "members q"],
        x0: Float[np.ndarray, "#members n"],
        reached: Float[np.ndarray, "#members points"],
        *,
        complete: bool = False,
    ) -> tuple[Response, Response, Aside]:
        """The same for several members at once, along a first axis.

        Args:
            p: parameters.
            x0: coefficients; a single row serves all members.
            reached: forces [N]; likewise.
            complete: all there is; otherwise only what a descent needs, the rest being None.
        """
        force = np.zeros((len(reached), self._size))
        force[:, : self._points] = reached
        sizes = p.shape[1], x0.shape[1], self._size
        return _traced(*self._key, sizes, self._family_key)(
            self._arrays, (p, x0, force), _ALL if complete else _OF_DESCENTS
        )

    def forces(
        self,
        p: Float[np.ndarray, " q"],
        x0: Float[np.ndarray, " n"],
        length: Float[np.ndarray, " k"],
        pressure: Float[np.ndarray, " k"],
        reached: Float[np.ndarray, " k"],
    ) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Force [N] and stiffness [N/m] of the muscle at any number of readings, all at once.

        Args:
            p: parameters; offsets of lengths are zero.
            x0: coefficients.
            length: of the readings [m].
            pressure: of the readings [Pa].
            reached: forces [N] by which a compliant rig gives way.
        """
        count, size = length.size, self._size
        members = -(-count // size)

        def folded(values: np.ndarray) -> np.ndarray:
            return np.pad(values, (0, members * size - count), mode="edge").reshape(members, size)

        own = [folded(length).T, folded(pressure).T, np.zeros((size, 1)), np.zeros((size, 1), int)]
        arrays = [a[..., None] for a in self._arrays]
        # Those of `MapInputs` come last, and of them those of the readings first.
        first = len(arrays) - len(dataclasses.fields(MapInputs))
        arrays[first : first + len(own)] = own
        force, stiffness = _traced(*self._key, (p.size, x0.size, size), self._family_key).forces(
            arrays, (p[None], x0[None], folded(reached))
        )
        return force.ravel()[:count], stiffness.ravel()[:count]


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
