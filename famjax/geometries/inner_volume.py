"""The volume that the fluid fills."""

import jax.numpy as jnp

from .._types import Real, RealArray
from .dimensions import AbstractGeometry
from .end_effect import EndEffectGeometry


def inner_volume(geometry: AbstractGeometry, length: Real, pressure: Real) -> RealArray:
    """Volume V [m3] of the fluid in a muscle: that of the braid's outline less the rubber's.

    Of a muscle with rounded ends it is V_c(L0) + (V_c(L) - V_c(L0))/k, V_c being that of the
    cylinder: its slope in the length is then the cylinder's, as the virtual work of the pressure
    wants, and at rest the ends count as the cylinder does.

    Args:
        geometry: of the muscle.
        length: active length L [m].
        pressure: gauge pressure P [Pa].

    Returns:
        V [m3], broadcast shape; nan where the geometry cannot be.
    """
    at = geometry.dimensions(length, pressure)
    if isinstance(geometry, EndEffectGeometry):
        rest = geometry.cylinder.dimensions(geometry.rest_length, jnp.zeros(()))
        return rest.volume + (at.volume - rest.volume) / geometry.end_factor - at.bladder_volume
    return at.volume - at.bladder_volume
