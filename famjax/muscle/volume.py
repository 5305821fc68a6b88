"""The fluid's volume of any muscle, continued beyond the states that its geometry knows."""

import jax
import jax.numpy as jnp

from .._compiled import compiled
from .._types import Real, RealArray, as_real
from .abstract_muscle import AbstractMuscle
from .region import Region


def continued_volume(
    muscle: AbstractMuscle, region: Region, length: Real, pressure: Real
) -> RealArray:
    """V [m3] at any length [m] and pressure [Pa], broadcast shape: positive, C1, rising as at the edge.

    Inside the region it is the muscle's own. Beyond an edge it goes on with the slope of the edge
    where it grows, and where it shrinks as V/(1 + s), which never reaches zero.

    Args:
        muscle: the model.
        region: where its geometry is taken as it is.
        length: active length L [m].
        pressure: gauge pressure P [Pa].
    """
    at = jnp.broadcast_arrays(as_real(length), as_real(pressure))
    return _continued(muscle, region, *at)


@compiled
def _continued(
    muscle: AbstractMuscle, region: Region, length: RealArray, pressure: RealArray
) -> RealArray:
    L = jnp.clip(length, region.length[0], region.length[1])
    P = jnp.clip(pressure, region.pressure[0], region.pressure[1])

    def along(pressure: RealArray) -> RealArray:
        volume, slope = jax.jvp(
            lambda length: muscle.volume(length, pressure), (L,), (jnp.ones_like(L),)
        )
        return _grown(volume, slope * (length - L))

    volume, slope = jax.jvp(along, (P,), (jnp.ones_like(P),))
    return _grown(volume, slope * (pressure - P))


def _grown(volume: RealArray, change: RealArray) -> RealArray:
    """V + dV where that grows, V/(1 - dV/V) where it shrinks: C1 and positive."""
    shrunk = volume / (1 - jnp.minimum(change, 0.0) / volume)
    return jnp.where(change < 0, shrunk, volume + change)
