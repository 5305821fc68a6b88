"""Sample muscles from the uncertainty of a fit, by varying all parameters of one model together."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..boundary.errors import InputError
from ..compile_options import quick_jit
from ..continuation import Region, grid_slopes, largest_share, rising, slack
from ..muscle import MountedMuscle, flatten, number_names
from .card import Sample, combined

_AT_ONCE = 32
_RISES = 0.9  # fraction of the region
_TRIES = 50  # per requested muscle
_NEAR = 0.05  # fraction of a draw's deviation for which the force is linear in the parameters
_CURVED = 5.0  # largest ratio of the sample's spread in force to that of linear theory


def draw(
    members: Sequence[MountedMuscle], weights: Any, directions: np.ndarray, region: Region,
    *, seed: int = 0, count: int = 32,
) -> Sample:  # fmt: skip
    """Sample muscles from the covariance of a fit; each of them has a safe continuation.

    The declared parameters p are sampled as p0 + sum z_k dp_k, with z_k standard normal, and the numbers
    follow from them. A draw is rejected if it does not describe a possible
    muscle: if a parameter leaves its declared range, the force is undefined somewhere in the region, or
    the force rises with pressure and length in less than nine tenths of the region.

    Args:
        members: models of the muscle; the parameters of the first model are varied.
        weights: weights of the members in the force.
        directions: independent directions d_k, each one standard deviation long, in the order of
            `flatten`, shape (directions, numbers).
        region: region in which the force of the card's muscle rises with pressure and length.
        seed: seed for NumPy's default generator.
        count: number of muscles to sample.

    Raises:
        InputError: too few of the draws are valid, or their forces spread over five times as far as
            linear theory predicts, because the parameters lie on a curved ridge.
    """
    first = members[0]
    flat, _ = flatten(first)
    rng, kept, tried = np.random.default_rng(seed), [], 0
    while len(kept) < count and tried < _TRIES * count:
        z = rng.standard_normal((_AT_ONCE, len(directions)))
        rows = np.asarray(_moved(first, directions, z))
        good, rises = map(np.asarray, _looked_at(tuple(members), weights, region, rows))
        kept += [
            one
            for one, valid, cells in zip(z, good, rises, strict=True)
            if valid and largest_share(cells) >= _RISES
        ]
        tried += _AT_ONCE
    if len(kept) < count:
        raise InputError(
            f"only {len(kept)} of {tried} sampled muscles are valid, but {count} are needed: the fit "
            "does not determine the parameters well enough"
        )
    z = np.array(kept[:count])
    near, far = (np.asarray(_moved(first, directions, scale * z)) for scale in (_NEAR, 1.0))
    close, away = _spreads(first, region, np.stack([flat, *near, *far]))
    if float(away) > _CURVED * float(close) / _NEAR:
        raise InputError(
            "the parameters lie on a curved ridge, so muscles sampled from the covariance would spread too "
            "far: use fitting.sample, which samples the posterior"
        )
    return Sample(seed, list(number_names(first)), far.tolist())


@quick_jit
def _looked_at(
    members: tuple[MountedMuscle, ...], weights: Any, region: Region, rows: Any
) -> tuple[Array, Array]:
    """Return for each row of numbers whether the muscle is valid, and where its force rises.

    Mountings are omitted to save time, because a series compliance does not change the sign of a slope.
    """

    def one(row: Array) -> tuple[Array, Array]:
        at = grid_slopes(combined(members, weights, row, rigid=True), region)
        possible = _in_ranges(flatten(members[0])[1](row)) & jnp.all(jnp.isfinite(at.force))
        return possible, jnp.asarray(rising(at)) | slack(at)

    return jax.lax.map(one, jnp.asarray(rows))  # one by one: equilibrium shapes need memory


@quick_jit
def _moved(muscle: MountedMuscle, directions: Any, z: Any) -> Array:
    """Return the numbers of muscles moved by z, shape (muscles, directions), linearly in the parameters.

    Numbers that do not follow from declared parameters move linearly themselves.
    """
    flat, rebuilt = flatten(muscle)
    names = tuple(muscle.declared())

    def declared(numbers: Array) -> Array:
        values = rebuilt(numbers).parameters()
        return jnp.stack([values[name] for name in names])

    def numbers(values: Array) -> Array:
        return flatten(muscle.with_parameters(dict(zip(names, values, strict=True))))[0]

    own = declared(flat)
    along = directions @ jax.jacfwd(declared)(flat).T
    others = directions - along @ jax.jacfwd(numbers)(own).T
    return jax.vmap(numbers)(own + z @ along) + z @ others


@quick_jit
def _spreads(muscle: MountedMuscle, region: Region, rows: Any) -> tuple[Array, Array]:
    """Return the RMS deviation in force of the first and second half of the rows after the first one."""
    (short, long), (low, high) = region.length, region.pressure
    L, P = jnp.meshgrid(jnp.linspace(short, long, 9), jnp.linspace(low, high, 9))

    def force(row: Array) -> Array:
        return flatten(muscle)[1](row).force(L, P)

    own, *others = jnp.split(jax.lax.map(force, jnp.asarray(rows)), [1, 1 + len(rows) // 2])
    pulls = own > 0
    near, far = (jnp.where(pulls, one - own, 0.0) for one in others)
    return jnp.sqrt(jnp.nanmean(near**2)), jnp.sqrt(jnp.nanmean(far**2))


def _in_ranges(mounted: MountedMuscle) -> Array:
    """Return True if every parameter is within its declared range, up to rounding."""
    values, known = mounted.parameters(), mounted.declared()
    ends = np.array([(one.low, one.high) for one in known.values()])
    low, high = (ends + 1e-9 * np.maximum(np.abs(ends), 1e-12) * [-1.0, 1.0]).T
    found = jnp.stack([values[name] for name in known])
    return jnp.all((low <= found) & (found <= high))
