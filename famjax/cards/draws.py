"""Muscles drawn from the uncertainty of a fit: the numbers of one of its models, varied together."""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..boundary.errors import InputError
from ..compile_options import quick_jit
from ..continuation import Region, grid_slopes, largest_share, rising
from ..muscle import MountedMuscle, flatten, number_names
from .card import Sample, varied

_AT_ONCE = 32
_RISES = 0.9  # of the region
_TRIES = 50  # times the number of muscles wanted


def draw(
    members: Sequence[MountedMuscle],
    weights: Float[Array | np.ndarray, " members"],
    directions: Float[np.ndarray, "directions numbers"],
    region: Region,
    *,
    seed: int = 0,
    count: int = 32,
) -> Sample:
    """Draw muscles from the covariance of a fit; each of them has a safe continuation.

    x = x0 + sum z_k d_k with z_k standard normal. What leaves the range that a parameter declares,
    has no force somewhere in the region, or rises in less than nine tenths of it, is drawn again:
    no muscle is like that.

    Args:
        members: models of the muscle; the first one's numbers vary.
        weights: theirs in the pull.
        directions: of one standard deviation each, independent of one another, in the order of
            `flatten`.
        region: in which the pull of the card's own muscle rises.
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
        good = _looked_at(tuple(members), weights, region, rows)
        possible, rises = (np.asarray(one) for one in good)
        kept += [
            row
            for row, one, cells in zip(rows, possible, rises, strict=True)
            if one and largest_share(cells) >= _RISES
        ]
        tried += _AT_ONCE
    if len(kept) < count:
        raise InputError(
            f"of {tried} muscles drawn from the fit's errors {len(kept)} have numbers in their ranges "
            f"and a pull that rises where the card's does, and {count} were wanted: the fit determines "
            "too little"
        )
    return Sample(seed, list(number_names(first)), np.array(kept[:count]).tolist())


@quick_jit
def _looked_at(
    members: tuple[MountedMuscle, ...],
    weights: Float[Array | np.ndarray, " members"],
    region: Region,
    rows: Float[Array | np.ndarray, "n numbers"],
) -> tuple[Bool[Array, " n"], Bool[Array, "n lengths pressures"]]:
    """Whether each muscle is possible and has a force everywhere, and where it rises.

    Without mountings, which take time: in series with them what rises still rises.
    """
    rigid = (False,) * len(members)

    def one(row: Array) -> tuple[Array, Array]:
        at = grid_slopes(varied(members, weights, row, mounted=rigid), region)
        possible = _in_ranges(flatten(members[0])[1](row)) & jnp.all(jnp.isfinite(at.force))
        return possible, jnp.asarray(rising(at))

    return jax.lax.map(one, jnp.asarray(rows))  # one by one: shapes from mechanics take memory


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
