"""The pressure's part of the pull by the braid's triangle."""

from jaxtyping import Float

from .._types import Given, Real, RealArray
from ..braids.gaylord import gaylord_force
from ..geometries.dimensions import Dimensions
from ..parameters import parameter
from .abstract_term import AbstractForceTerm

HIGHEST_DEADBAND = 200e3
"""End of the range [Pa] of a deadband that is identified."""


class PressurisedBraid(AbstractForceTerm):
    """Gaylord's force of the braid, (P - P_d) pi R^2 (2 tan(theta)^2 - 1).

    Attributes:
        deadband_pressure: P_d [Pa], pressure before the muscle acts.

    References:
        Gaylord 1958; Chambers 2021, equation 6.1.
    """

    deadband_pressure: Float[Given, "..."] = parameter(
        "Pa", low=0.0, high=HIGHEST_DEADBAND, default=0.0
    )

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The braid's pull [N], broadcast shape; negative below the neutral angle."""
        return gaylord_force(pressure - self.deadband_pressure, at.radius, at.braid_angle)
