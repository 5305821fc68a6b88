"""Compiled programs of the engine: the linear model, and the convex fit with its Jacobian.

One linear model is compiled for each structure of a family, and one convex fit for each size. Readings,
weights, bounds, specimens and priors are arguments, padded to sizes that many maps share.

JAX's cache stores compiled programs but not traces, and tracing takes longer than a fit. If that cache is
enabled, whole executables are therefore stored next to it. The key of an executable depends on the sources
of famjax and fitting, the machine, the version of JAX, and the name and array shapes of the function. If a
stored file cannot be read, the function is compiled again.
"""

import contextlib
import dataclasses
import functools
import hashlib
import os
import pickle
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from famjax.compilation_cache import machine
from famjax.compile_options import Options, bulk_options, quick_options

from .convex import AnyArray, Optimum, bucket, solve_qp
from .problem import Part, Problem
from .response import Constraint, Linear, MapInputs, Report, linear_response, report


def kept(
    function: Callable[..., Any], name: str, like: Any, options: Options | None = None
) -> Callable[..., Any]:
    """Compile a function, and share the executable between processes.

    Args:
        function: function from pytrees of arrays to a pytree of arrays.
        name: key of the executable. Different functions need different names, and the function must not
            run code from outside famjax and fitting.
        like: pytree with the structure of the result.
        options: compiler options; default: those for a program that runs often.

    Returns:
        A function equivalent to `jax.jit(function)`, but not differentiable.
    """
    structure = jax.tree.structure(like)
    known: dict[Any, Callable[..., Any]] = {}

    def called(*args: Any) -> Any:
        leaves, treedef = jax.tree.flatten(args)
        key = treedef, *((leaf.shape, leaf.dtype) for leaf in leaves)
        if key not in known:
            given = [jax.ShapeDtypeStruct(*one) for one in key[1:]]

            def flat(*leaves: Any) -> list[Any]:
                return jax.tree.leaves(function(*jax.tree.unflatten(treedef, leaves)))

            known[key] = _executable(flat, name, given, options or bulk_options())
        return jax.tree.unflatten(structure, known[key](*leaves))

    return called


def _executable(
    flat: Callable[..., list[Any]],
    name: str,
    given: Sequence[jax.ShapeDtypeStruct],
    options: Options,
) -> Callable[..., Any]:
    """Return the stored executable of a function of leaves, or compile it and store it."""
    folder = jax.config.values.get("jax_compilation_cache_dir")
    if not folder:
        return jax.jit(flat, compiler_options=options)
    from jax.experimental import serialize_executable as stored  # noqa: PLC0415

    text = f"{_sources()} {machine()} {jax.default_backend()} {options} {name} {given}"
    key = hashlib.sha256(text.encode()).hexdigest()[:32]
    file = Path(folder) / f"executable-{key}-cache"
    with contextlib.suppress(Exception):  # of another version of JAX, or torn
        whole, lapack = pickle.loads(file.read_bytes())
        if lapack:  # JAX registers it when it lowers a program; an executable calls it at once
            jax.jit(jnp.linalg.qr).lower(np.eye(1))
        found = stored.deserialize_and_load(*whole)
        jax.block_until_ready(found(*(np.zeros(one.shape, one.dtype) for one in given)))
        return found
    # JAX cannot serialize what it has loaded from its own cache, so nothing is left there: a name
    # that no other process has, and no file.
    flat.__name__ = f"executable_{key}_{os.getpid()}"
    lowered = jax.jit(flat, compiler_options=options).lower(*given)
    compiled = lowered.compile()
    with contextlib.suppress(
        Exception
    ):  # a full disk, or a device that cannot store, keeps nothing
        for own in Path(folder).glob(f"jit_{flat.__name__}*"):
            own.unlink()
        torn = file.with_suffix(f".{os.getpid()}")
        torn.write_bytes(pickle.dumps((stored.serialize(compiled), "lapack" in lowered.as_text())))
        torn.replace(file)
    return compiled


@functools.cache
def _sources() -> str:
    """Return a digest of the JAX version and of all code that may be traced."""
    import famjax  # noqa: PLC0415
    import fitting  # noqa: PLC0415

    digest = hashlib.sha256(f"{jax.__version__} {jax.config.read('jax_enable_x64')}".encode())
    for package in (famjax, fitting):
        for file in sorted(Path(str(package.__file__)).parent.rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()


MEMBERS = 16
"""Number of fits in one call to a compiled program."""


DIRECTIONS = 7
"""Largest number of free parameters in an automatically chosen family; a program differentiates with
respect to each."""


class Sizes(NamedTuple):
    """Padded sizes of a problem: `rows` counts rows along paths, `others` further least-squares rows."""

    readings: int
    rows: int
    coefficients: int
    parameters: int
    directions: int
    others: int


class Group(NamedTuple):
    """Parts with the same structure, stacked along a leading axis.

    If there are several fits, all fields except `arrays` have one more leading axis.

    Attributes:
        arrays: arrays of families and inputs.
        to_p: 1 where a parameter of the problem belongs to the part, shape (parts, q, parameters).
        held: values of the part's other parameters, shape (parts, q).
        to_x: the same as `to_p` for the coefficients, shape (parts, n, coefficients).
    """

    arrays: tuple[Any, ...]
    to_p: Float[AnyArray, "parts q parameters"]
    held: Float[AnyArray, "parts q"]
    to_x: Float[AnyArray, "parts n coefficients"]


class Form(NamedTuple):
    """Static description of a group: how its family and inputs are built from arrays.

    Attributes:
        treedef: structure of (family, inputs).
        static: leaves that are not arrays, each in a tuple; None in place of an array.
        shapes: shapes and types of the arrays of one part.
    """

    treedef: Any
    static: tuple[Any, ...]
    shapes: tuple[tuple[tuple[int, ...], str], ...]

    @property
    def points(self) -> int:
        """Number of readings including padding; the arrays of `MapInputs` come last."""
        return self.shapes[-len(dataclasses.fields(MapInputs))][0][0]

    @property
    def own_code(self) -> bool:
        """False if a user-defined class is involved, because its name does not identify its code."""
        nodes, kinds = [self.treedef], set()
        while nodes:
            node = nodes.pop()
            nodes += node.children()
            kinds |= {data[0] for data in (node.node_data(),) if data is not None}
        named = {value for leaf in self.static for value in leaf or () if callable(value)}
        return all(
            one.__module__.partition(".")[0] in ("famjax", "fitting", "builtins")
            for one in kinds | named
        )

    def filled(self, arrays: Sequence[Array]) -> tuple[Any, MapInputs]:
        """Build family and inputs from arrays."""
        given = iter(arrays)
        leaves = [next(given) if kept is None else kept[0] for kept in self.static]
        return jax.tree.unflatten(self.treedef, leaves)


def form_of(part: Part, size: int) -> tuple[Form, list[np.ndarray]]:
    """Return the form and arrays of a part (of its larger family, if any), padded to `size` readings."""
    family = part.family if part.within is None else part.within.family
    leaves, treedef = jax.tree.flatten((family, _padded(part.inputs, size)))
    arrays = [np.asarray(leaf) for leaf in leaves if eqx.is_array_like(leaf)]
    static = tuple(None if eqx.is_array_like(leaf) else (leaf,) for leaf in leaves)
    return Form(treedef, static, tuple((a.shape, a.dtype.str) for a in arrays)), arrays


def _padded(at: MapInputs, size: int) -> MapInputs:
    """Repeat the last reading and path to reach a size that many maps share."""
    extra, paths = size - at.length.size, at.path_end.size
    more = bucket(paths, 2 if paths <= 2 else 4) - paths

    def longer(values: np.ndarray, by: int) -> np.ndarray:
        return np.concatenate([values, np.repeat(values[-1:], by, axis=0)]) if by else values

    readings = (at.length, at.pressure, at.force)
    return MapInputs(
        *(longer(v, extra) for v in readings),
        *(longer(v, more) for v in (at.path_pressure, at.path_end, at.stations)),
    )


def joined(groups: Sequence[Group]) -> Group:
    """Join the groups of several fits that share their arrays."""
    each = (np.stack([getattr(one, name) for one in groups]) for name in Group._fields[1:])
    return Group(groups[0].arrays, *each)


class Layout:
    """Positions of a problem's parts among the padded readings and rows, and their groups."""

    def __init__(self, problem: Problem) -> None:
        size = bucket(max(part.force.size for part in problem.parts), 64)
        n, q = len(problem.linear), len(problem.names)
        alike: dict[Form, list[tuple[int, list[np.ndarray]]]] = {}
        for place, part in enumerate(problem.parts):
            form, arrays = form_of(part, size)
            alike.setdefault(form, []).append((place, arrays))
        whole = [len(part.within.held) for part in problem.parts if part.within is not None]
        wide_n, wide_q = bucket(n, 4), max(whole, default=bucket(q, 8))
        along = problem.constraint in ("slope", "drucker")
        self.forms, groups = tuple(alike), []
        at_readings, at_rows, first, first_row = {}, {}, 0, 0
        for form, members in alike.items():
            to_p, held, to_x = [], [], []
            for place, arrays in members:
                part, within = problem.parts[place], problem.parts[place].within
                own = np.eye(wide_q)[part.at]
                to_p.append(own if within is None else within.to_p @ own)
                held.append(np.zeros(len(own)) if within is None else within.held)
                own = np.eye(n, wide_n)
                to_x.append(own if within is None else within.to_x @ own)
                at_readings[place] = first + np.arange(part.force.size)
                first += form.points
                at_rows[place] = first_row + np.arange(part.inputs.stations.size * along)
                first_row += arrays[-1].size * along
            stacked = tuple(map(np.stack, zip(*(arrays for _, arrays in members), strict=True)))
            groups.append(Group(stacked, np.stack(to_p), np.stack(held), np.stack(to_x)))
        self.groups = tuple(groups)
        self.readings, self.rows = (
            np.concatenate([of[k] for k in range(len(problem.parts))])
            for of in (at_readings, at_rows)
        )
        others = wide_n - n + len(problem.priors) + len(problem.coefficient_priors)
        rows = bucket(first_row, 64) if first_row else 0
        free = max(len(problem.free), DIRECTIONS)
        self.sizes = Sizes(bucket(first, 64), rows, wide_n, wide_q, free, bucket(others, 8))

    def spread(
        self, values: Shaped[np.ndarray, "*b points"], missing: float | None = None
    ) -> Shaped[np.ndarray, "*b readings"]:
        """Put values at the padded positions of readings; fill gaps with `missing` or the last value."""
        known = np.zeros(self.sizes.readings, bool)
        known[self.readings] = True
        last = np.maximum.accumulate(np.where(known, np.arange(known.size), 0))
        found = np.full((*values.shape[:-1], known.size), missing or 0, values.dtype)
        found[..., self.readings] = values
        return found if missing is not None else found[..., last]


def linear_of(
    forms: Sequence[Form],
    groups: Sequence[Group],
    constraint: Constraint,
    p: Float[Array, " parameters"],
    moves: Float[Array, "directions parameters"],
    x0: Float[Array, " coefficients"],
    readings: tuple[Array, Array, Array],
) -> tuple[Linear, Linear]:
    """Return the linear model of a problem, and its derivatives along directions of the parameters.

    Args:
        forms: forms of the groups.
        groups: groups of parts.
        constraint: constraint on the coefficients.
        p: parameters of the problem.
        moves: directions in the space of the parameters.
        x0: coefficients of the problem.
        readings: length [m], pressure [Pa] and current model force [N], each of shape (readings,).
    """
    values, slopes, first = [], [], 0
    for form, group in zip(forms, groups, strict=True):
        parts = len(group.to_p)
        here = slice(first, first + parts * form.points)
        first = here.stop
        one = functools.partial(_of_part, form, constraint, p, moves, x0)
        own = tuple(v[here].reshape(parts, -1) for v in readings)
        each: Any = group.arrays, group.to_p, group.held, group.to_x, own
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
    p: Array,
    moves: Array,
    x0: Array,
    arrays: Sequence[Array],
    to_p: Float[Array, "q parameters"],
    held: Float[Array, " q"],
    to_x: Float[Array, "n coefficients"],
    readings: tuple[Array, Array, Array],
) -> tuple[Linear, Linear]:
    """Return the linear model of a part, and its derivatives along directions of the parameters."""
    family, at = form.filled(arrays)
    length, pressure, reached = readings
    at = dataclasses.replace(at, length=length, pressure=pressure)

    def response(own_p: Array) -> Linear:
        return linear_response(family, constraint, at, own_p, x0, reached, to_x)

    value, slope = jax.linearize(response, held + to_p @ p)
    return value, jax.vmap(slope)(moves @ to_p.T)


@functools.lru_cache(maxsize=128)
def linear_program(
    forms: tuple[Form, ...],
    constraint: Constraint,
    sizes: Sizes,
) -> Any:
    """Compile the linear model of a structure for several fits at once.

    Args:
        forms: forms of the groups of parts.
        constraint: constraint on the coefficients.
        sizes: sizes of the padded problem.
    """

    def one(
        groups: tuple[Group, ...],
        p: Array,
        moves: Array,
        x0: Array,
        readings: tuple[Array, Array, Array],
    ) -> tuple[Linear, Linear]:
        value, slope = linear_of(forms, groups, constraint, p, moves, x0, readings)

        def padded(found: Linear, axis: int) -> Linear:
            wide = (sizes.readings, sizes.readings, sizes.rows, sizes.rows)
            by = (np.eye(leaf.ndim, dtype=int)[axis] for leaf in found)
            return Linear(
                *(
                    jnp.pad(leaf, [(0, more * (size - leaf.shape[axis])) for more in one])
                    for leaf, one, size in zip(found, by, wide, strict=True)
                )
            )

        return padded(value, 0), padded(slope, 1)

    axes: Any = tuple(Group(cast(Any, None), *cast(Any, (0, 0, 0))) for _ in forms)
    many = jax.vmap(one, in_axes=(axes, 0, 0, 0, 0))
    if not all(form.own_code for form in forms):
        return jax.jit(many, compiler_options=bulk_options())
    like = Linear(*range(4)), Linear(*range(4))
    return kept(many, f"linear {forms} {constraint} {sizes}", like)


class Weighing(NamedTuple):
    """Measured forces, weights, bounds and priors of a fit.

    Attributes:
        force: measured force [N], shape (readings,).
        weight: weights of the readings; 0 for padding, shape (readings,).
        low, high: bounds on the coefficients; infinite where there is none, shape (coefficients,).
        rows, targets: further least-squares rows, such as priors.
        d_targets: derivatives of the targets with respect to the parameters, shape (parameters, others).
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
    """Return A, b, G and h of the convex programme for a linear model."""
    A = jnp.concatenate([of.weight[:, None] * linear.columns, of.rows])
    b = jnp.concatenate([of.weight * (of.force - linear.force), of.targets])
    size = jax.lax.stop_gradient(jnp.sqrt(jnp.sum(A**2, axis=0)))
    A = jnp.concatenate([A, jnp.diag(of.ridge * jnp.where(size > 0, size, 1.0))])
    on = jnp.isfinite(of.low), jnp.isfinite(of.high)
    G = [linear.rows, jnp.diag(1.0 * on[0]), -jnp.diag(1.0 * on[1])]
    h = [-linear.values, jnp.where(on[0], of.low, -1.0), jnp.where(on[1], -of.high, -1.0)]
    return A, jnp.concatenate([b, jnp.zeros(size.shape)]), jnp.concatenate(G), jnp.concatenate(h)


class Projected(NamedTuple):
    """The convex fit at given parameters, with its residual A x - b and the residual's derivatives."""

    optimum: Optimum
    residual: Float[AnyArray, " rows"]
    jacobian: Float[AnyArray, "directions rows"]
    A: Float[AnyArray, "rows coefficients"]
    b: Float[AnyArray, " rows"]
    G: Float[AnyArray, "m coefficients"]
    h: Float[AnyArray, " m"]


def projected(linear: Linear, slopes: Linear, of: Weighing) -> Projected:
    """Solve the convex fit of a linear model, and differentiate its residual through the optimum."""

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
    """Compile the convex fit with its Jacobian for several fits at once; all structures share it."""
    one, number = np.zeros(1), np.zeros(())
    optimum = Optimum(one, one, one > 0, number, number, number, number, np.zeros((), int))
    like = Projected(optimum, *range(len(Projected._fields) - 1))
    return kept(jax.vmap(projected), "projected", like, quick_options())


@functools.lru_cache(maxsize=128)
def report_program(form: Form) -> Any:
    """Compile the function that computes the report for a part."""

    def one(arrays: list[Array], p: Array, x: Array, reached: Array) -> Report:
        return report(*form.filled(arrays), p, x, reached)

    if not form.own_code:
        return jax.jit(one, compiler_options=quick_options())
    return kept(one, f"report {form}", Report(*range(len(Report._fields))), quick_options())
