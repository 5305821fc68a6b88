"""Muscles drawn from what a fit leaves open: the numbers of one of its models, moved together."""

import dataclasses
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..boundary.errors import InputError
from ..compile_options import quick_jit
from ..muscle import (
    AbstractMuscle,
    MeanMuscle,
    MountedMuscle,
    Region,
    flatten,
    grid_slopes,
    number_names,
    rising,
)

_AT_ONCE = 32
_TRIES = 50  # times the number of muscles wanted


@dataclasses.dataclass(frozen=True, eq=False)
class Draws:
    """Numbers of muscles drawn by a seed.

    Attributes:
        seed: of NumPy's default generator.
        names: of the numbers, as attributes of `famjax.MountedMuscle`.
        rows: SI, shape (muscles, numbers).
    """

    seed: int
    names: tuple[str, ...]
    rows: Float[np.ndarray, "muscles numbers"]


def varied(
    members: Sequence[MountedMuscle],
    weights: Float[Array, " members"],
    numbers: Float[Array, " numbers"],
    *,
    gives_way: bool,
) -> AbstractMuscle:
    """The muscle with other numbers of its first member; the others' pull moves along with it.

    So the spread of the pull is the first member's, whatever its weight: what a fit knows of the
    others' numbers is not said.
    """
    first = flatten(members[0])[1](numbers)
    if len(members) == 1:
        return joined([first], weights, gives_way=gives_way)
    shifted = jnp.concatenate([jnp.ones(1), weights.at[0].add(-1.0)])
    return joined([first, *members], shifted, gives_way=gives_way)


def joined(
    members: Sequence[MountedMuscle], weights: Float[Array, " members"], *, gives_way: bool
) -> AbstractMuscle:
    """One muscle of all members, without their mountings where no mounting gives way."""
    own = [one if gives_way else one.muscle for one in members]
    return own[0] if len(own) == 1 else MeanMuscle(own, weights)


def any_gives_way(members: Sequence[MountedMuscle]) -> bool:
    """Whether the mounting of a member is compliant."""
    return any(bool(np.any(np.asarray(one.compliance))) for one in members)


def draw(
    members: Sequence[MountedMuscle],
    weights: Float[Array, " members"],
    directions: Float[np.ndarray, "directions numbers"],
    region: Region,
    *,
    seed: int = 0,
    count: int = 32,
) -> Draws:
    """Muscles whose numbers vary as a fit's do, each of which rises throughout the region.

    x = x0 + sum z_k d_k with z_k standard normal. What leaves the range that a parameter declares,
    or is not monotone in the region, is drawn again: no muscle is like that.

    Args:
        members: models of the muscle; the first one's numbers vary.
        weights: theirs in the pull.
        directions: of one standard deviation each, independent of one another, in the order of
            `flatten`.
        region: in which the pull must rise with length and pressure.
        seed: of NumPy's default generator.
        count: of muscles.

    Raises:
        InputError: hardly any draw is a muscle, or the directions are of another muscle.
    """
    first = members[0]
    flat, _ = flatten(first)
    if directions.ndim != 2 or directions.shape[1] != flat.size:
        raise InputError(
            f"the directions must be of {flat.size} numbers, got shape {directions.shape}"
        )
    rng, kept, tried = np.random.default_rng(seed), [], 0
    while len(kept) < count and tried < _TRIES * count:
        z = rng.standard_normal((_AT_ONCE, len(directions)))
        rows = np.asarray(flat) + z @ directions
        good = np.asarray(_sound(tuple(members), weights, region, rows, any_gives_way(members)))
        kept += [row for row, fine in zip(rows, good, strict=True) if fine]
        tried += _AT_ONCE
    if len(kept) < count:
        raise InputError(
            f"of {tried} muscles drawn from the fit's errors {len(kept)} have numbers in their ranges "
            f"and a pull that rises throughout the data, and {count} were wanted: the fit determines "
            "too little"
        )
    return Draws(seed, number_names(first), np.array(kept[:count]))


@quick_jit
def _sound(
    members: tuple[MountedMuscle, ...],
    weights: Float[Array, " members"],
    region: Region,
    rows: Float[Array | np.ndarray, "n numbers"],
    gives_way: bool,
) -> Bool[Array, " n"]:
    def one(row: Array) -> Array:
        muscle = varied(members, weights, row, gives_way=gives_way)
        rises = rising(grid_slopes(muscle, region))
        return _in_ranges(flatten(members[0])[1](row)) & jnp.all(rises)

    return jax.vmap(one)(jnp.asarray(rows))


def _in_ranges(mounted: MountedMuscle) -> Bool[Array, ""]:
    """Whether no parameter has left the range that it declares, by more than rounding."""
    values = mounted.parameters()
    inside = jnp.ones((), bool)
    for name, spec in mounted.declared().items():
        for end, sign in ((spec.low, 1.0), (spec.high, -1.0)):
            if math.isfinite(end):
                spare = 1e-9 * max(abs(end), 1e-12)
                inside &= sign * (values[name] - end) >= -spare
    return inside
