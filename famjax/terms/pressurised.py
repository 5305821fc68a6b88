"""The pressure's part of the pull: by the braid's triangle, or by the volume that it fills."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from .._types import Given, Real, RealArray
from ..braids.gaylord import gaylord_force
from ..geometries.estimated import Dimensions
from ..parameters import parameter
from .abstract import AbstractForceTerm

_HIGHEST_DEADBAND = 200e3  # Pa


class PressurisedBraid(AbstractForceTerm):
    """Gaylord's force of the braid, (P - P_d) pi R^2 (2 tan(theta)^2 - 1).

    Attributes:
        deadband_pressure: P_d [Pa], pressure before the muscle acts.

    References:
        Gaylord 1958; Chambers 2021, equation 6.1.
    """

    deadband_pressure: Float[Given, "..."] = parameter(
        "Pa", low=0.0, high=_HIGHEST_DEADBAND, default=0.0
    )

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The braid's pull [N], broadcast shape; negative below the neutral angle."""
        return gaylord_force(pressure - self.deadband_pressure, at.radius, at.braid_angle)


class VirtualWork(AbstractForceTerm):
    """The pressure's pull by virtual work, -(P - P_d) dV/dL, whatever the outline's shape.

    dV/dL is the derivative, at constant pressure, of the volume that the geometry itself gives: the
    term holds no geometry of its own, whose numbers would then have to be kept the same. Where the
    threads stretch, a part of the work P dV goes into them; see `volume_rate`.

    Attributes:
        deadband_pressure: P_d [Pa], pressure before the muscle acts.
        at_thread_length: take dV/dL at constant thread length, dV/dL - (dV/dB) dB/dL, so that the
            work that stretches the threads does not count as the muscle's.

    References:
        Chou & Hannaford 1996.
    """

    deadband_pressure: Float[Given, "..."] = parameter(
        "Pa", low=0.0, high=_HIGHEST_DEADBAND, default=0.0
    )
    at_thread_length: bool = eqx.field(static=True, default=False)

    uses_rates: ClassVar[bool] = True

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The pressure's pull [N], broadcast shape.

        Raises:
            ValueError: the dimensions come without rates, or without the thread length asked for.
        """
        if at.rates is None:
            raise ValueError(
                "virtual work needs the rate of the volume: dimensions with their `rates`, as "
                "Muscle gives them to its terms, or geometry.dimensions_with_rates"
            )
        rate = at.rates.volume
        if self.at_thread_length:
            if at.thread_length is None or at.rates.thread_length is None:
                raise ValueError(
                    "virtual work at constant thread length needs a geometry whose dimensions say "
                    "their thread_length; this one does not"
                )
            B, L = at.thread_length, at.length
            rate = rate - at.rates.thread_length * 2 * B * at.volume / ((B - L) * (B + L))
        return jnp.asarray(-(pressure - self.deadband_pressure) * rate)
