"""Models that differ in their numbers alone, asked as one."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ._types import RealArray

_M = TypeVar("_M")


def of_each(
    function: Callable[..., RealArray], models: Sequence[_M], *arguments: Sequence[RealArray]
) -> RealArray:
    """What a function returns of several models, each with its own arguments, along a leading axis.

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
