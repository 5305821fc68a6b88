"""The two array types of public annotations, and the conversion between them."""

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Num

if TYPE_CHECKING:
    Given: TypeAlias = Any
else:
    Given: TypeAlias = Array


Real: TypeAlias = Num[Array | np.ndarray | np.number | float | int, "..."]
"""A real number or array of any shape; arguments of one function broadcast against each other."""

RealArray: TypeAlias = Float[Array, "..."]
"""A floating-point JAX array whose shape is the broadcast shape of the arguments."""

"""The array of a declared field: the constructor takes whatever `as_real` makes one of."""


_NOTHING = np.zeros(())


def as_real(values: ArrayLike | Sequence[Any]) -> RealArray:
    """Convert values or nested lists to a floating array; integers are promoted, float32 stays float32."""
    array = jnp.asarray(values)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def as_number(values: ArrayLike | Sequence[Any]) -> RealArray:
    """Like `as_real`, but for stored values: a Python float takes JAX's default precision.

    Left "weak", as it is, a muscle of Python floats would be compiled apart from the same one read from a
    file, every program twice. What is made within a trace takes on the precision of what it meets.
    """
    if in_trace():
        return as_real(values)
    if isinstance(values, float | int | np.number | np.ndarray):
        # What NumPy converts takes no program of JAX's, which each takes a hundredth of a second.
        array = np.array(values)
        return jax.device_put(array if array.dtype.kind == "f" else array.astype(float))
    array = as_real(values)
    return jnp.asarray(array, array.dtype) if array.weak_type else array


def in_trace() -> bool:
    """Whether JAX is tracing here, as inside `jax.jit`; nothing is compiled to find out."""
    return isinstance(jax.device_put(_NOTHING), Tracer)


_P = ParamSpec("_P")
_T = TypeVar("_T")
_Method = TypeVar("_Method", bound=Callable[..., Any])

_jit: Any = eqx.filter_jit


def compiled(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Compile a function, tracing the arrays in its arguments; inside a trace it is inlined.

    Args:
        function: of the module's own level, so that it is traced once and not at every call.

    Returns:
        The same function.
    """
    return promoting(_jit(function, inline=True))


def promoting(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Allow rank promotion inside a function, even if the caller's JAX configuration forbids it."""

    @functools.wraps(function)
    def called(*args: _P.args, **named: _P.kwargs) -> _T:
        with jax.numpy_rank_promotion("allow"):
            return function(*args, **named)

    return called


def compiled_method(method: _Method) -> _Method:
    """Compile a method of a module as one program when it is called outside a trace.

    Operation by operation, its first call would compile a program for each and take up to four times as
    long.
    Within a trace it is the method itself.

    Args:
        method: of arrays and numbers alone.

    Returns:
        The same method.
    """
    whole = compiled(method)

    @promoting
    @functools.wraps(method)
    def called(*arguments: Any, **named: Any) -> Any:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((arguments, named))):
            return method(*arguments, **named)
        owner, *values = arguments
        numbers = {name: as_real(value) for name, value in named.items()}
        return whole(owner, *map(as_real, values), **numbers)

    return called  # type: ignore[return-value] # of the method's own signature


def at_each(function: Callable[..., _T], *arguments: RealArray) -> _T:
    """Apply a function of scalars to every element of arguments whose shapes broadcast.

    Scalars are handed on as they are: a batch of one would be traced, lowered and compiled in
    twice the time.

    Args:
        function: of as many scalars as there are arguments; an array or a pytree of arrays.
        *arguments: of any shapes that broadcast.

    Returns:
        The same, every array with the broadcast shape in front of its own.
    """
    arrays = jnp.broadcast_arrays(*arguments)
    shape = arrays[0].shape
    if shape == ():
        return function(*arrays)
    flat = jax.vmap(function)(*(array.ravel() for array in arrays))
    return jax.tree.map(lambda leaf: leaf.reshape(shape + leaf.shape[1:]), flat)


_M = TypeVar("_M")


def of_each(
    function: Callable[..., RealArray], models: Sequence[_M], *arguments: Sequence[RealArray]
) -> RealArray:
    """Apply a function to several models, each with its own arguments, along a leading axis.

    Models of one structure are stacked and mapped over, so that the program holds the function once
    and not once for each: what is compiled grows with the number of copies. Others are asked in turn.

    Args:
        function: of a model and its arguments.
        models: equinox modules, or whatever else the function takes.
        *arguments: a sequence for each argument, with an entry for each model, all of one shape.

    Returns:
        Array with a leading axis of models.
    """
    split = [eqx.partition(one, eqx.is_array) for one in models]
    numbers, rest = [one for one, _ in split], [one for _, one in split]
    if len(models) > 1 and _alike(numbers, rest):
        stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *numbers)
        return jax.vmap(lambda one, *own: function(eqx.combine(one, rest[0]), *own))(
            stacked, *(jnp.stack(one) for one in arguments)
        )
    return jnp.stack([function(*one) for one in zip(models, *arguments, strict=True)])


def _alike(numbers: Sequence[Any], rest: Sequence[Any]) -> bool:
    """Whether models have one structure, numbers of the same shapes and nothing else that differs."""
    shapes = [[(leaf.shape, leaf.dtype) for leaf in jax.tree.leaves(one)] for one in numbers]
    trees = [jax.tree.structure(one) for one in numbers]
    return (
        bool(shapes[0])
        and all(one == shapes[0] for one in shapes)
        and all(one == trees[0] for one in trees)
        and all(bool(eqx.tree_equal(one, rest[0])) for one in rest)
    )


def over_slope(linear: Callable[[RealArray], RealArray], value: RealArray) -> RealArray:
    """The x at which a linear function of a scalar equals a value: the `tangent_solve` of a root.

    Where its slope is zero or not finite there is no root, and the value itself is returned: one
    member of a batch without a root leaves the derivatives of the others as they are.
    """
    slope = linear(jnp.ones_like(value))
    usable = jnp.isfinite(slope) & (slope != 0)
    return value / jnp.where(usable, slope, 1.0)
