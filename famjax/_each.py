"""A function of scalars at every member of arrays."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp

from ._types import RealArray

_T = TypeVar("_T")


def at_each(function: Callable[..., _T], *arguments: RealArray) -> _T:
    """What a function of scalars returns at every member of arguments whose shapes broadcast.

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
