"""The compiled programs of the engine: a linear model, and the convex fit with its Jacobian.

The linear model is one program for each structure of a family, the convex fit one for each size,
whatever the model. Readings, weights, bounds, specimens and priors are their arguments, padded to
sizes that many maps share.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from famjax.compile_options import bulk_options, quick_options

from .convex import AnyArray, Optimum, bucket, solve_qp
from .problem import Part, Problem
from .response import Constraint, Linear, MapInputs, Report, linear_response, report

MEMBERS = 8
"""Fits that a compiled program takes at once."""
BULK = 32
"""The same where there are hundreds."""


class Sizes(NamedTuple):
    """Sizes to which a problem is padded: readings, rows along paths, coefficients, parameters, others."""

    readings: int
    rows: int
    coefficients: int
    parameters: int
    others: int


class Group(eqx.Module):
    """Parts of one structure, with a leading axis of parts.

    Attributes:
        arrays: of families and inputs.
        to_p: 1 where a parameter of the problem is one of the part, shape (parts, q, parameters).
        to_x: likewise of the coefficients, shape (parts, n, coefficients).
        alone: whether it is one part, whose parameters and coefficients are the first.
    """

    arrays: tuple[Any, ...]
    to_p: Float[AnyArray, "parts q parameters"]
    to_x: Float[AnyArray, "parts n coefficients"]
    alone: bool = eqx.field(static=True)


class Form(NamedTuple):
    """What is static in a group: how its family and inputs are made of arrays.

    Attributes:
        treedef: of (family, inputs).
        static: leaves that are no arrays, each in a tuple; None in the place of an array.
        shapes: of the arrays of one part.
    """

    treedef: Any
    static: tuple[Any, ...]
    shapes: tuple[tuple[tuple[int, ...], str], ...]

    @property
    def points(self) -> int:
        """Number of readings, padded ones included; the arrays of `MapInputs` come last."""
        return self.shapes[-len(dataclasses.fields(MapInputs))][0][0]

    def filled(self, arrays: Sequence[Array]) -> tuple[Any, MapInputs]:
        """Family and inputs of some arrays."""
        given = iter(arrays)
        leaves = [next(given) if kept is None else kept[0] for kept in self.static]
        return jax.tree.unflatten(self.treedef, leaves)


def form_of(part: Part, size: int) -> tuple[Form, list[np.ndarray]]:
    """The form of a part padded to a number of readings, and its arrays."""
    leaves, treedef = jax.tree.flatten((part.family, _padded(part.inputs, size)))
    arrays = [np.asarray(leaf) for leaf in leaves if eqx.is_array_like(leaf)]
    static = tuple(None if eqx.is_array_like(leaf) else (leaf,) for leaf in leaves)
    return Form(treedef, static, tuple((a.shape, a.dtype.str) for a in arrays)), arrays


def _padded(at: MapInputs, size: int) -> MapInputs:
    """The same inputs, the last reading and path repeated up to a size that many maps share."""
    extra, paths = size - at.length.size, at.path_end.size
    more = 0 if paths <= 2 else bucket(paths, 4) - paths

    def longer(values: np.ndarray, by: int) -> np.ndarray:
        return np.concatenate([values, np.repeat(values[-1:], by, axis=0)]) if by else values

    readings = (at.length, at.pressure, at.force, at.length_index)
    return MapInputs(
        *(longer(v, extra) for v in readings),
        *(longer(v, more) for v in (at.path_pressure, at.path_end, at.stations)),
    )


class Layout:
    """Where the parts of a problem are among padded readings and rows; the groups of its parts.

    Args:
        problem: whose parts are laid out.
        exact: whether nothing is padded.
    """

    def __init__(self, problem: Problem, *, exact: bool = False) -> None:
        most = max(part.force.size for part in problem.parts)
        n, q = len(problem.linear), len(problem.names)
        alike: dict[Form, list[tuple[int, list[np.ndarray]]]] = {}
        for place, part in enumerate(problem.parts):
            size = part.force.size if exact else bucket(most, 64)
            form, arrays = form_of(part, size)
            alike.setdefault(form, []).append((place, arrays))
        wide_n, wide_q = (n, q) if exact else (bucket(n, 4), bucket(q, 8))
        self.forms, groups = tuple(alike), []
        self.readings, self.rows = np.zeros(0, int), np.zeros(0, int)
        at_readings, at_rows, first, first_row = {}, {}, 0, 0
        along = problem.constraint in ("slope", "drucker")
        for form, members in alike.items():
            to_p, to_x = [], []
            for place, arrays in members:
                part = problem.parts[place]
                to_p.append(np.eye(wide_q)[part.at])
                to_x.append(np.eye(wide_n)[part.coefficients])
                at_readings[place] = first + np.arange(part.force.size)
                first += form.points
                if along:
                    at_rows[place] = first_row + np.arange(part.inputs.stations.size)
                    first_row += arrays[-1].size
            stacked = tuple(
                np.stack(leaves) for leaves in zip(*(a for _, a in members), strict=True)
            )
            alone = len(problem.parts) == 1 and all(
                np.array_equal(places, np.arange(places.size))
                for places in (problem.parts[0].at, problem.parts[0].coefficients)
            )
            groups.append(Group(stacked, np.stack(to_p), np.stack(to_x), alone))
        self.groups = tuple(groups)
        self.readings = np.concatenate([at_readings[k] for k in range(len(problem.parts))])
        if along:
            self.rows = np.concatenate([at_rows[k] for k in range(len(problem.parts))])
        others = wide_n - n + len(problem.priors) + len(problem.coefficient_priors)
        self.sizes = Sizes(
            first if exact else bucket(first, 64),
            first_row if exact or not first_row else bucket(first_row, 64),
            wide_n, wide_q, others if exact else bucket(others, 4),
        )  # fmt: skip

    def spread(
        self, values: Float[np.ndarray, "*b points"], missing: float = 0.0
    ) -> Float[np.ndarray, "*b readings"]:
        """Numbers of all readings at their padded places."""
        found = np.full((*values.shape[:-1], self.sizes.readings), missing)
        found[..., self.readings] = values
        return found


def linear_of(
    forms: Sequence[Form],
    groups: Sequence[Group],
    constraint: Constraint,
    p: Float[Array, " parameters"],
    x0: Float[Array, " coefficients"],
    readings: tuple[Array, Array, Array],
) -> tuple[Linear, Linear]:
    """The linear model of a problem, and its derivatives along each parameter.

    Args:
        forms: of the groups.
        groups: of the parts.
        constraint: on the coefficients.
        p: parameters of the problem.
        x0: its coefficients.
        readings: length [m], pressure [Pa] and force reached [N], each of shape (readings,).
    """
    values, slopes, first = [], [], 0
    for form, group in zip(forms, groups, strict=True):
        parts = len(group.to_p)
        here = slice(first, first + parts * form.points)
        first = here.stop
        one = functools.partial(_of_part, form, constraint, group.alone, p, x0)
        own = tuple(v[here].reshape(parts, -1) for v in readings)
        each: Any = group.arrays, group.to_p, group.to_x, own
        if parts == 1:
            found = jax.tree.map(lambda leaf: leaf[None], one(*jax.tree.map(lambda v: v[0], each)))
        else:
            found = jax.vmap(one)(*each)
        value, slope = found
        values.append(Linear(*(leaf.reshape(-1, *leaf.shape[2:]) for leaf in value)))
        moved = (jnp.moveaxis(leaf, 0, 1) for leaf in slope)
        slopes.append(Linear(*(leaf.reshape(len(leaf), -1, *leaf.shape[3:]) for leaf in moved)))

    def joined(each: list[Linear], axis: int) -> Linear:
        return Linear(*(jnp.concatenate(leaves, axis) for leaves in zip(*each, strict=True)))

    return joined(values, 0), joined(slopes, 1)


def _of_part(
    form: Form,
    constraint: Constraint,
    alone: bool,
    p: Array,
    x0: Array,
    arrays: Sequence[Array],
    to_p: Float[Array, "q parameters"],
    to_x: Float[Array, "n coefficients"],
    readings: tuple[Array, Array, Array],
) -> tuple[Linear, Linear]:
    """The linear model of a part in the parameters and coefficients of the problem, and its slopes."""
    (q, wide_q), (n, wide_n) = to_p.shape, to_x.shape
    family, at = form.filled(arrays)
    length, pressure, reached = readings
    at = dataclasses.replace(at, length=length, pressure=pressure)
    # What one part has for itself needs no products, which are slow in code that is not optimised.
    own_p, own_x = (p[:q], x0[:n]) if alone else (to_p @ p, to_x @ x0)

    def in_x(leaf: Float[Array, "... n"]) -> Float[Array, "... coefficients"]:
        if alone:
            return jnp.pad(leaf, ((0, 0),) * (leaf.ndim - 1) + ((0, wide_n - n),))
        return leaf @ to_x

    def in_p(leaf: Array) -> Array:
        if alone:
            return jnp.pad(leaf, ((0, wide_q - q),) + ((0, 0),) * (leaf.ndim - 1))
        return jnp.tensordot(to_p, leaf, (0, 0))

    def response(own_p: Array) -> Linear:
        found = linear_response(family, constraint, at, own_p, own_x, reached)
        return Linear(found[0], in_x(found[1]), found[2], in_x(found[3]))

    if not q:
        value = response(own_p)
        return value, Linear(*(jnp.zeros((wide_q, *leaf.shape)) for leaf in value))
    value, slope = jax.linearize(response, own_p)
    return value, Linear(*(in_p(leaf) for leaf in jax.vmap(slope)(jnp.eye(q))))


@functools.lru_cache(maxsize=128)
def linear_program(
    forms: tuple[Form, ...], constraint: Constraint, sizes: Sizes, *, bulk: bool = False
) -> Any:
    """The compiled linear model of a structure, for several fits at once.

    Args:
        forms: of the groups of parts.
        constraint: on the coefficients.
        sizes: of the padded problem.
        bulk: whether it runs so often that optimised code is worth its compilation.
    """

    def one(
        groups: tuple[Group, ...], p: Array, x0: Array, readings: tuple[Array, Array, Array]
    ) -> tuple[Linear, Linear]:
        value, slope = linear_of(forms, groups, constraint, p, x0, readings)
        readings_, rows = sizes.readings - len(value.force), sizes.rows - len(value.values)
        by = Linear(*(((0, more),) for more in (readings_, readings_, rows, rows)))

        def padded(leaf: Array, by: tuple, leading: int) -> Array:
            rest = ((0, 0),) * (leaf.ndim - leading - 1)
            return jnp.pad(leaf, ((0, 0),) * leading + by + rest)

        return (
            Linear(*(padded(v, b, 0) for v, b in zip(value, by, strict=True))),
            Linear(*(padded(v, b, 1) for v, b in zip(slope, by, strict=True))),
        )

    options = bulk_options() if bulk else quick_options()
    return jax.jit(jax.vmap(one, in_axes=(None, 0, 0, 0)), compiler_options=options)


class Weighing(NamedTuple):
    """What is known of a fit besides its model.

    Attributes:
        force: measured [N], shape (readings,).
        weight: of the readings, 0 for none, shape (readings,).
        low, high: bounds of the coefficients, infinite where there is none, shape (coefficients,).
        rows, targets: further rows of the least squares, priors among them.
        d_targets: derivative of the targets in the parameters, shape (parameters, others).
        ridge: see `Problem`.
    """

    force: Float[AnyArray, " readings"]
    weight: Float[AnyArray, " readings"]
    low: Float[AnyArray, " coefficients"]
    high: Float[AnyArray, " coefficients"]
    rows: Float[AnyArray, "others coefficients"]
    targets: Float[AnyArray, " others"]
    d_targets: Float[AnyArray, "parameters others"]
    ridge: Float[AnyArray, ""]


def programme(linear: Linear, of: Weighing) -> tuple[Array, Array, Array, Array]:
    """A, b, G and h of the convex programme of a linear model."""
    A = jnp.concatenate([of.weight[:, None] * linear.columns, of.rows])
    b = jnp.concatenate([of.weight * (of.force - linear.force), of.targets])
    size = jax.lax.stop_gradient(jnp.sqrt(jnp.sum(A**2, axis=0)))
    A = jnp.concatenate([A, jnp.diag(of.ridge * jnp.where(size > 0, size, 1.0))])
    on = jnp.isfinite(of.low), jnp.isfinite(of.high)
    G = [linear.rows, jnp.diag(1.0 * on[0]), -jnp.diag(1.0 * on[1])]
    h = [-linear.values, jnp.where(on[0], of.low, -1.0), jnp.where(on[1], -of.high, -1.0)]
    return A, jnp.concatenate([b, jnp.zeros(size.shape)]), jnp.concatenate(G), jnp.concatenate(h)


class Projected(NamedTuple):
    """The convex fit at given parameters, and its residual A x - b with the derivative in these."""

    optimum: Optimum
    residual: Float[AnyArray, " rows"]
    jacobian: Float[AnyArray, "parameters rows"]
    A: Float[AnyArray, "rows coefficients"]
    b: Float[AnyArray, " rows"]
    G: Float[AnyArray, "m coefficients"]
    h: Float[AnyArray, " m"]


def projected(linear: Linear, slopes: Linear, of: Weighing) -> Projected:
    """The convex fit of a linear model, and the derivative of its residual through the optimum."""

    def residual(linear: Linear, targets: Array) -> tuple[Array, tuple]:
        given = programme(linear, of._replace(targets=targets))
        optimum = solve_qp(*given)
        return given[0] @ optimum.x - given[1], (optimum, *given)

    def along(slope: Linear, d_targets: Array) -> tuple[Array, Array, tuple]:
        return jax.jvp(residual, (linear, of.targets), (slope, d_targets), has_aux=True)

    r, jacobian, (optimum, *given) = jax.vmap(along, out_axes=(None, 0, None))(slopes, of.d_targets)
    return Projected(optimum, r, jacobian, *given)


@functools.cache
def projected_program() -> Any:
    """The compiled convex fit with its Jacobian, for several at once; all structures share it."""
    options = bulk_options()
    axes: Any = (*(0,) * 4, None, 0, None, None)  # of rows, slopes and ridge there is one for all
    shared = Weighing(*axes)
    return jax.jit(jax.vmap(projected, in_axes=(0, 0, shared)), compiler_options=options)


@functools.lru_cache(maxsize=128)
def report_program(form: Form) -> Any:
    """The compiled report of a part."""

    def one(arrays: list[Array], p: Array, x: Array, reached: Array) -> Report:
        return report(*form.filled(arrays), p, x, reached)

    return jax.jit(one, compiler_options=quick_options())
