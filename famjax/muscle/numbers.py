"""All numbers of a muscle in one row: what its errors and its samples are said in."""

from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .mounted import MountedMuscle


def flatten(
    mounted: MountedMuscle,
) -> tuple[Float[Array, " numbers"], Callable[[Float[Array, " numbers"]], MountedMuscle]]:
    """All numbers of a mounted muscle in one row, and the way back."""
    numbers, rest = eqx.partition(mounted, eqx.is_inexact_array)
    flat, unflat = ravel_pytree(numbers)
    return flat, lambda changed: eqx.combine(unflat(changed), rest)


def number_names(mounted: MountedMuscle) -> tuple[str, ...]:
    """Names of the numbers of `flatten`, such as "muscle.geometry.braid.turns"."""
    leaves = jax.tree_util.tree_flatten_with_path(eqx.filter(mounted, eqx.is_inexact_array))[0]
    return tuple(
        jax.tree_util.keystr(path).lstrip(".") + "".join(f"[{i}]" for i in index)
        for path, leaf in leaves
        for index in np.ndindex(np.shape(leaf))
    )
