"""Array types for public annotations, conversion to arrays, and compilation of functions and methods."""

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

# Annotation of a declared field, whose converter accepts whatever `as_number` accepts.
if TYPE_CHECKING:
    Given: TypeAlias = Any
else:
    Given: TypeAlias = Array

Real: TypeAlias = Num[Array | np.ndarray | np.number | float | int, "..."]
"""A real number or an array of any shape; the arguments of a function broadcast against each other."""

RealArray: TypeAlias = Float[Array, "..."]
"""A floating-point JAX array whose shape is the broadcast shape of the arguments."""

_NOTHING = np.zeros(())


def as_real(values: ArrayLike | Sequence[Any]) -> RealArray:
    """Convert values or nested lists to a floating-point array; floats keep their type."""
    array = jnp.asarray(values)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def as_number(values: ArrayLike | Sequence[Any]) -> RealArray:
    """Convert values for storage as `as_real` does, except that Python floats get JAX's default precision.

    If stored values kept JAX's weak type, a muscle created from Python floats and the same muscle read
    from a file would be compiled separately. Inside a trace, values keep the weak type.
    """
    if in_trace():
        return as_real(values)
    if isinstance(values, float | int | np.number | np.ndarray):
        # Conversion in NumPy saves a compiled program, about 10 ms each.
        array = np.array(values)
        return jax.device_put(array if array.dtype.kind == "f" else array.astype(float))
    array = as_real(values)
    return jnp.asarray(array, array.dtype) if array.weak_type else array


def in_trace() -> bool:
    """Return True while JAX is tracing, for example inside `jax.jit`. The check compiles nothing."""
    return isinstance(jax.device_put(_NOTHING), Tracer)


_P = ParamSpec("_P")
_T = TypeVar("_T")
_Method = TypeVar("_Method", bound=Callable[..., Any])

_jit: Any = eqx.filter_jit


def compiled(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Compile a module-level function of arrays. Inside a trace, the function is inlined."""
    return promoting(_jit(function, inline=True))


def promoting(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Allow rank promotion inside a function, even if the caller's JAX configuration forbids it."""

    @functools.wraps(function)
    def called(*args: _P.args, **named: _P.kwargs) -> _T:
        with jax.numpy_rank_promotion("allow"):
            return function(*args, **named)

    return called


def compiled_method(method: _Method, jit: Callable[..., Any] = compiled) -> _Method:
    """Compile a method of an `equinox.Module` whose arguments are numbers or arrays.

    Without this decorator, the first call outside `jax.jit` would compile a separate program for every
    operation, which takes up to four times as long.

    Args:
        method: method of an `equinox.Module`.
        jit: function that compiles the method, `compiled` or `famjax.compile_options.quick_jit`.
    """
    whole = jit(method)

    @functools.wraps(method)
    def called(owner: Any, *values: Any, **named: Any) -> Any:
        numbers = {name: as_real(value) for name, value in named.items()}
        return whole(owner, *map(as_real, values), **numbers)

    return called  # type: ignore[return-value] # of the method's own signature


def at_each(function: Callable[..., _T], *arguments: RealArray) -> _T:
    """Apply a function of scalars to every element of the broadcast arguments.

    Scalar arguments are passed directly, because a batch of one takes twice as long to compile.

    Args:
        function: function that takes one scalar per argument and returns an array or a pytree of arrays.
        *arguments: arrays whose shapes broadcast.

    Returns:
        The results, as arrays whose leading axes have the broadcast shape.
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
    """Apply a function to several models, each with its own arguments.

    Models with the same structure are stacked and mapped, so the function is compiled only once.

    Args:
        function: function of a model and of the arguments for that model.
        models: equinox modules.
        *arguments: one sequence per argument, with one entry per model; all entries have the same shape.

    Returns:
        An array whose leading axis runs over the models.
    """
    kinds = [
        jax.tree.map(lambda x: (x.shape, str(x.dtype)) if eqx.is_array(x) else x, one)
        for one in models
    ]
    if len(models) == 1 or not eqx.tree_equal(*kinds):
        return jnp.stack([function(*one) for one in zip(models, *arguments, strict=True)])
    split = [eqx.partition(one, eqx.is_array) for one in models]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(numbers for numbers, _ in split))
    return jax.vmap(lambda one, *own: function(eqx.combine(one, split[0][1]), *own))(
        stacked, *map(jnp.stack, arguments)
    )


def over_slope(linear: Callable[[RealArray], RealArray], value: RealArray) -> RealArray:
    """Return the x at which a linear scalar function equals a value, for use as `tangent_solve`.

    If the slope is zero or not finite, there is no such x. The function then returns the value itself, so
    that this element of a batch does not affect the derivatives of the others.
    """
    slope = linear(jnp.ones_like(value))
    usable = jnp.isfinite(slope) & (slope != 0)
    return value / jnp.where(usable, slope, 1.0)
