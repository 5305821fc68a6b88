"""Where a braid's own travel ends: locked at the neutral angle, or with its threads straight."""

import math

import jax.numpy as jnp

from .._types import RealArray
from ..braids.inextensible import NEUTRAL_ANGLE
from .dimensions import AbstractGeometry
from .end_effect import EndEffectGeometry


def braid_limits(geometry: AbstractGeometry) -> tuple[RealArray, RealArray]:
    """Active lengths [m] at which the unloaded braid locks, and at which its threads are straight.

    Locked, at the neutral angle, pressure shortens it no further; with straight threads nothing but
    their stretch lengthens it.

    Args:
        geometry: of one muscle. Rounded ends shift both lengths.

    Returns:
        (lock, straight) [m], nan for a geometry that has no braid.

    References:
        Chambers 2021, section 2.1: the neutral angle, 35.26 deg from the circumference.
    """
    factor = jnp.ones(())
    if isinstance(geometry, EndEffectGeometry):
        geometry, factor = geometry.cylinder, geometry.end_factor
    braid, rest = getattr(geometry, "braid", None), geometry.rest_length
    if braid is None:
        return jnp.full((), jnp.nan), jnp.full((), jnp.nan)
    thread = braid.rest_thread_length
    lock, straight = (
        rest + (length - rest) / factor for length in (thread * math.sin(NEUTRAL_ANGLE), thread)
    )
    return lock, straight
