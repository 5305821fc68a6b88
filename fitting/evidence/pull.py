"""The force of an identified muscle with its error band, by one small program for any question.

The linear theory (delta method): the numbers of the muscle vary along directions of one standard
deviation each, independent of one another, and the force with them; see `muscle_spread`.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax.compile_options import as_arrays, quick_jit
from famjax.muscle import flatten

from ..shared_program import in_shared_program

ROWS = 512
"""Rows that one call computes; fewer are filled up, more computed in parts."""


@dataclasses.dataclass(frozen=True)
class Pull:
    """Forces at lengths and pressures.

    Attributes:
        force: what the rig measures [N].
        muscle_force: of the muscle alone, were it of that length itself [N].
        std: standard deviation of `force` [N], from the parameters and from the lengths.
    """

    force: Float[np.ndarray, " n"]
    muscle_force: Float[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]


def pull(
    mounted: famjax.MountedMuscle,
    spread: Float[np.ndarray, "directions numbers"] | None,
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
    *,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> Pull:
    """Forces of a muscle, and how well they are known by linear theory.

    Args:
        mounted: the identified muscle in its rig.
        spread: from `muscle_spread`; None where nothing is known of the errors.
        length: active lengths [m] as the rig measures them.
        pressure: gauge pressures [Pa].
        rest_length: L0 [m] of another muscle, which `famjax.cut_to_length` makes of it.
        length_std: standard deviation of the lengths [m].

    Returns:
        The forces, nan where the muscle has none.

    Raises:
        ValueError: the muscle cannot be cut to another length.
    """
    if spread is None:
        numbers = jax.tree.leaves(eqx.filter(mounted, eqx.is_inexact_array))
        spread = np.zeros((0, sum(np.size(one) for one in numbers)))
    rig = "gives way" if np.asarray(mounted.compliance).any() else "rigid"
    of = None if rest_length is None else np.asarray(rest_length)
    parts = []
    for start in range(0, len(length), ROWS):
        L, P = length[start : start + ROWS], pressure[start : start + ROWS]
        lengths, pressures = (np.pad(values, (0, ROWS - len(values)), "edge") for values in (L, P))
        found = _pull(
            as_arrays(mounted), of, spread, np.asarray(length_std), lengths, pressures, rig
        )
        parts.append([values[: len(L)] for values in found])
    return Pull(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def force_of(
    mounted: famjax.MountedMuscle,
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """What the rig measures [N] at lengths [m] and pressures [Pa]; nan where there is no force."""
    whole = in_shared_program(mounted)
    rigid = whole is mounted and not np.asarray(mounted.compliance).any()
    count, parts = len(length), []
    for start in range(0, count, ROWS):
        L, P = length[start : start + ROWS], pressure[start : start + ROWS]
        filled = (np.pad(values, (0, ROWS - len(values)), "edge") for values in (L, P))
        found = _force(as_arrays(mounted.muscle if rigid else whole), *filled)
        parts.append(np.asarray(found)[: len(L)])
    return np.concatenate(parts) if parts else np.zeros(0)


@quick_jit
def _force(
    muscle: famjax.AbstractMuscle, length: Array | np.ndarray, pressure: Array | np.ndarray
) -> Array:
    return muscle.force(length, pressure)


@quick_jit
def _pull(
    mounted: famjax.MountedMuscle,
    rest_length: Array | np.ndarray | None,
    spread: Array | np.ndarray,
    length_std: Array | np.ndarray,
    length: Array | np.ndarray,
    pressure: Array | np.ndarray,
    rig: str,
) -> tuple[Array, Array, Array]:
    flat, unflat = flatten(mounted)

    def alone(mounted: famjax.MountedMuscle) -> famjax.AbstractMuscle:
        if rest_length is None:
            return mounted.muscle
        return famjax.cut_to_length(mounted.muscle, rest_length)

    def force(flat: Array, length: Array) -> Array:
        changed = unflat(flat)
        one = alone(changed)
        if rig == "gives way":
            return changed.with_muscle(one).force(length, pressure)
        return one.force(length, pressure)

    def along(direction: Array, lengths: Array) -> tuple[Array, Array]:
        return jax.jvp(force, (flat, jnp.asarray(length)), (direction, lengths))

    # One direction more: all lengths together by their standard deviation.
    directions = jnp.concatenate([spread, jnp.zeros((1, flat.size))])
    last = jnp.broadcast_to(length_std, (1, len(length)))
    lengths = jnp.concatenate([jnp.zeros((len(spread), len(length))), last])
    found, slopes = jax.vmap(along, out_axes=(None, 0))(directions, lengths)
    std = jnp.sqrt(jnp.sum(slopes**2, axis=0))
    muscle_force = alone(mounted).force(length, pressure) if rig == "gives way" else found
    return found, muscle_force, std
