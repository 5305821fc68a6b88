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
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from famjax.compile_options import quick_options

from ..trace import tape_store
from ..trace.held import with_held
from ..trace.tape import UnknownPrimitiveError, record
from .family import AbstractFamily
from .response import Aside, Constraint, MapInputs, Response, bucket, response

_FIELDS = (*Response._fields, *Response._fields, *Aside._fields)
_SLOPES = range(len(Response._fields), 2 * len(Response._fields))
_VALUES = [k for k in range(len(_FIELDS)) if k not in _SLOPES]
OF_READINGS, OF_PATHS = frozenset({"force", "columns"}), frozenset({"values", "rows"})
OF_DESCENTS = OF_READINGS | OF_PATHS | {"gain"}
"""What a descent needs of the results."""
ALL = frozenset(_FIELDS)
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

        def along_all(arrays: list[Array], p: Array, x0: Array, reached: Array) -> list[Array]:
            def along(direction: Array) -> tuple[Response, Response, Aside]:
                return function(arrays, list(p), x0, reached, list(direction))

            unit = jnp.eye(self._parameters)
            return jax.tree.leaves(jax.vmap(along, out_axes=(None, 0, None))(unit))

        def packed(*arguments: Any) -> Array:
            return jnp.concatenate([leaf.ravel() for leaf in along_all(*arguments)])

        self._arrays, self._parameters = len(examples[0]), len(examples[1])
        self._runs: dict[Any, Callable[..., list[np.ndarray]]] = {}
        self._tape = tape_store.load(key)
        if self._tape is not None:
            return
        try:
            self._tape = record(leaves, *examples)
            tape_store.save(key, self._tape)
        except UnknownPrimitiveError:
            arrays, _, x0, reached, _ = examples
            p = jax.ShapeDtypeStruct((self._parameters,), float)
            found = jax.eval_shape(along_all, arrays, p, x0, reached)
            self._shapes = [leaf.shape for leaf in found]
            self._compiled = jax.jit(
                jax.vmap(packed, in_axes=(None, 0, 0, 0)), compiler_options=quick_options()
            )

    def __call__(
        self,
        arrays: list[np.ndarray],
        varying: tuple[np.ndarray, ...],
        fields: frozenset[str],
        moving: Sequence[int],
        held: Mapping[int, float],
        slopes: frozenset[str],
    ) -> tuple[Response, Response, Aside]:
        """Members along the first axis, of arguments and of results; see `Program.of_members`."""
        if self._tape is None:
            found: list[Any] = self._compiled_leaves(arrays, varying)
        else:
            found, members = [None] * len(_FIELDS), max(len(v) for v in varying)
            once = tuple(k for k in _VALUES if _FIELDS[k] in fields)
            each = tuple(k for k in _SLOPES if _FIELDS[k] in slopes)
            results = iter(
                self._on_tape([a[..., None] for a in arrays], varying, once, each, moving, held)
            )
            for place in once:
                value = next(results)
                of_each = np.broadcast_to(value, (*value.shape[:-1], members))
                found[place] = np.ascontiguousarray(np.moveaxis(of_each, -1, 0))
            for place in each:
                shape = found[place - len(Response._fields)].shape[1:]
                found[place] = np.zeros((members, self._parameters, *shape))
            for parameter in moving:
                for place in each:
                    found[place][:, parameter] = np.moveaxis(next(results), -1, 0)
        split = len(Response._fields)
        return (
            Response(*found[:split]), Response(*found[split : 2 * split]), Aside(*found[2 * split :])
        )  # fmt: skip

    def forces(
        self, arrays: list[np.ndarray], varying: tuple[np.ndarray, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Force and gain alone, each of shape (members, points).

        Args:
            arrays: of the family and the inputs, with members along a last axis, which may be one.
            varying: p, x0 and the forces reached, with members along the first axis.
        """
        places = _FIELDS.index("force"), _FIELDS.index("gain")
        members = len(varying[-1])
        if self._tape is not None:
            found = self._on_tape(arrays, varying, places)
            shape = (varying[-1].shape[1], members)
            force, gain = (np.broadcast_to(value, shape).T for value in found)
            return force, gain
        singles = [
            self._compiled_leaves([a[..., min(k, a.shape[-1] - 1)] for a in arrays],
                                  (varying[0], varying[1], varying[2][k : k + 1]))
            for k in range(members)
        ]  # fmt: skip
        force, gain = (np.concatenate([one[place] for one in singles]) for place in places)
        return force, gain

    def _on_tape(
        self,
        arrays: list[np.ndarray],
        varying: tuple[np.ndarray, ...],
        once: tuple[int, ...],
        each: tuple[int, ...] = (),
        moving: Sequence[int] = (),
        held: Mapping[int, float] | None = None,
    ) -> list[np.ndarray]:
        """Results at the places `once`, then those at the places `each` along each parameter."""
        assert self._tape is not None
        p, x0, reached = (np.moveaxis(v, 0, -1) for v in varying)
        none = x0.shape[-1] == 1 and not x0.any()  # what most fits are linear about
        asked = once, each, tuple(moving), tuple((held or {}).items()), none
        if asked not in self._runs:
            count, first = self._parameters, self._arrays
            last = first + count + 2
            always = {first + k: np.array(value) for k, value in (held or {}).items()}
            if none:
                always[first + count] = np.zeros(x0.shape[0])
            turns = [
                {last + k: np.array(1.0 * (k == parameter)) for k in range(count)}
                for parameter in moving
            ]
            self._runs[asked] = with_held(self._tape, always, turns, once, each).run
        return self._runs[asked](*arrays, *p, x0, reached, *(None for _ in p))

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
        arrays: list[Array], p: list[Array], x0: Array, reached: Array, direction: list[Array]
    ) -> tuple[Response, Response, Aside]:
        given = iter(arrays)
        leaves = [next(given) if kept is None else kept[0] for kept in static]
        family, at = jax.tree.unflatten(treedef, leaves)

        def of_parameters(p: list[Array]) -> tuple[Response, Aside]:
            return response(family, constraint, at, p, x0, reached)

        return jax.jvp(of_parameters, (p,), (direction,), has_aux=True)

    def array(shape: tuple[int, ...], kind: str = "f8") -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(shape, np.dtype(kind))

    arrays = [array(shape, kind) for shape, kind in shapes]
    key = None if family_key is None else tape_store.identity(family_key, constraint, shapes, sizes)
    numbers = [array(()) for _ in range(sizes[0])]
    return _Traced(
        function, (arrays, numbers, array((sizes[1],)), array((sizes[2],)), numbers), key
    )


class Program:
    """The linear model of a family at the readings and paths of one map.

    Sent to another process it is made there anew, since structures of JAX cannot be sent.

    Args:
        family: its models.
        constraint: on their coefficients.
        at: readings and paths.
        size: number of readings that one call takes, if it is not that of `at`.
    """

    def __init__(
        self,
        family: AbstractFamily,
        constraint: Constraint,
        at: MapInputs,
        size: int | None = None,
    ) -> None:
        self._made_of = family, constraint, at
        self._points, padded = at.length.size, _padded(at, size)
        self._size = padded.length.size
        leaves, treedef = jax.tree.flatten((family, padded))
        self._arrays = [np.asarray(leaf) for leaf in leaves if eqx.is_array_like(leaf)]
        static = tuple(None if eqx.is_array_like(leaf) else (leaf,) for leaf in leaves)
        self._key = treedef, static, constraint, tuple((a.shape, a.dtype.str) for a in self._arrays)

    @functools.cached_property
    def _family_key(self) -> str | None:
        # Not sooner: a process that was sent this learns afterwards where tapes are kept.
        return tape_store.identity(self._made_of[0].identity)

    def __reduce__(self) -> tuple[type["Program"], tuple[Any, ...]]:
        return Program, (*self._made_of, self._size)

    def at(self, inputs: MapInputs) -> "Program":
        """The same program at other readings and paths of the same sizes; nothing is traced."""
        other = copy.copy(self)
        other._made_of = (*self._made_of[:2], inputs)
        other._points = inputs.length.size
        own = [np.asarray(leaf) for leaf in jax.tree.leaves(_padded(inputs, self._size))]
        other._arrays = [*self._arrays[: len(self._arrays) - len(own)], *own]
        return other

    def with_family(self, family: AbstractFamily, inputs: MapInputs) -> "Program | None":
        """The same program of other numbers; None where the family has another structure."""
        other = Program(family, self._key[2], inputs)
        return other if other._key == self._key else None

    @property
    def structure(self) -> tuple[Any, ...]:
        """Equal of programs that differ in numbers only."""
        return self._key

    @property
    def contents(self) -> tuple[Any, ...]:
        """Equal of programs that give the same results."""
        return (*self._key, *(array.tobytes() for array in self._arrays))

    @property
    def size(self) -> int:
        """Number of readings that one call takes."""
        return self._size

    def __call__(
        self,
        p: Float[np.ndarray, " q"],
        x0: Float[np.ndarray, " n"],
        reached: Float[np.ndarray, " points"],
        *fields: str,
        slopes: bool = False,
    ) -> tuple[Response, Response, Aside]:
        """Values, derivatives in p (leading axis of parameters), and what has none.

        Args:
            p: parameters.
            x0: coefficients.
            reached: forces [N].
            fields: of the results; the others are None.
            slopes: whether to differentiate; otherwise derivatives are zero, or right.
        """
        found = self.of_members(
            p[None], x0[None], reached[None], frozenset(fields), range(p.size) if slopes else ()
        )
        return jax.tree.map(lambda leaf: leaf[0], found)

    def of_members(
        self,
        p: Float[np.ndarray, "members q"],
        x0: Float[np.ndarray, "#members n"],
        reached: Float[np.ndarray, "#members points"],
        fields: frozenset[str],
        moving: Sequence[int],
        held: Mapping[int, float] | None = None,
        slopes: frozenset[str] | None = None,
    ) -> tuple[Response, Response, Aside]:
        """The same for several members at once, along a first axis.

        Args:
            p: parameters.
            x0: coefficients; a single row serves all members.
            reached: forces [N]; likewise.
            fields: of the results; the others are None.
            moving: places of the parameters in which to differentiate; other derivatives are zero,
                or right.
            held: values of parameters that are the same in many calls, by their places.
            slopes: fields that are differentiated; others may have no derivative. All unless given.
        """
        force = np.zeros((len(reached), self._size))
        force[:, : self._points] = reached
        sizes = p.shape[1], x0.shape[1], self._size
        return _traced(*self._key, sizes, self._family_key)(
            self._arrays,
            (p, x0, force),
            fields,
            moving,
            held or {},
            fields if slopes is None else slopes,
        )

    def forces(
        self,
        p: Float[np.ndarray, " q"],
        x0: Float[np.ndarray, " n"],
        length: Float[np.ndarray, " k"],
        pressure: Float[np.ndarray, " k"],
        reached: Float[np.ndarray, " k"],
    ) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Force [N] of the muscle and the rig's gain, see `Aside`, at any number of readings at once.

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
        force, gain = _traced(*self._key, (p.size, x0.size, size), self._family_key).forces(
            arrays, (p[None], x0[None], folded(reached))
        )
        return force.ravel()[:count], gain.ravel()[:count]


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
