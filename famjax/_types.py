"""The two array types of the public annotations, and the conversion between them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Num

Real: TypeAlias = Num[Array | np.ndarray | np.number | float | int, "..."]
"""A real number or array of any shape; arguments of one function broadcast against each other."""

RealArray: TypeAlias = Float[Array, "..."]
"""A floating-point JAX array whose shape is the broadcast shape of the arguments."""

if TYPE_CHECKING:
    Given: TypeAlias = Any
else:
    Given: TypeAlias = Array
"""The array of a declared field: the constructor takes whatever `as_real` makes one of."""


_NOTHING = np.zeros(())


def as_real(values: ArrayLike | Sequence[Any]) -> RealArray:
    """The values (also nested lists) as a floating array: integers are promoted, float32 stays float32."""
    array = jnp.asarray(values)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def as_number(values: ArrayLike | Sequence[Any]) -> RealArray:
    """As `as_real`, for what is kept: a Python float is of JAX's own precision, as an array of it is.

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
    """Whether JAX traces what is made here, as within `jax.jit`; nothing is compiled to know it."""
    return isinstance(jax.device_put(_NOTHING), Tracer)
