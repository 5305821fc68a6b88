"""The pressure's pull by virtual work, F = -P dV/dL: a braid force that assumes no cylinder.

The bladder and the braid keep their volume, so that the outline's volume and the fluid's have the
same derivative.
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Float

from .._each import at_each
from .._types import Given, Real, RealArray, as_real
from ..braids.gaylord import gaylord_force
from ..braids.inextensible import AbstractBraid
from ..geometries.dimensions import AbstractGeometry, Dimensions
from ..geometries.meridian import Meridian
from ..parameters import parameter
from ..profiles.family import AbstractProfileFamily
from .abstract_term import AbstractForceTerm
from .pressurised_braid import HIGHEST_DEADBAND


def volume_rate(
    source: AbstractGeometry | AbstractProfileFamily,
    length: Real,
    pressure: Real,
    *,
    braid: AbstractBraid | None = None,
) -> RealArray:
    """Change of the outline's volume with the length, dV/dL [m2], negative where a muscle pulls.

    By automatic differentiation at constant pressure. Where the threads stretch, that is not yet
    the force: of the work P dV a part goes into the threads. With U their energy, F = -P dV/dL +
    dU/dL, and at equilibrium dU = P (dV/dB) dB, so that F belongs to the rate at constant B,

    dV/dL - (dV/dB) dB/dL,  dV/dB = 2 B V / (B^2 - L^2),

    because the stretch scales every diameter with sqrt(B^2 - L^2). Give the braid to have this
    second form; for inextensible threads the two are the same.

    Args:
        source: geometry or family of profiles. A measured one is only as good as the spacing and
            the noise of its profiles: the integral of the rate between two of them is exact.
        length: active length L [m].
        pressure: gauge pressure P [Pa].
        braid: elastic braid whose stretch is taken out, usually the source's own.

    Returns:
        dV/dL [m2], broadcast shape.
    """
    return _rates(source, as_real(length), as_real(pressure), braid)


def virtual_work_force(
    source: AbstractGeometry | AbstractProfileFamily,
    length: Real,
    pressure: Real,
    *,
    braid: AbstractBraid | None = None,
) -> RealArray:
    """Pull [N] of the pressure on the outline, F = -P dV/dL, whatever the outline's shape.

    Friction is neglected, and the work that stretches the threads unless the braid is given.

    Args:
        source: geometry or family of profiles, whose outline encloses V(L, P); see `volume_rate`.
        length: active length L [m].
        pressure: gauge pressure P [Pa].
        braid: elastic braid whose stretch is taken out, usually the source's own.

    Returns:
        F [N], broadcast shape; for an `EstimatedGeometry` with an inelastic braid, or with its
        elastic braid given, it is Gaylord's force.

    References:
        Chou & Hannaford 1996.

    >>> from famjax import Bladder, Braid, EstimatedGeometry
    >>> muscle = EstimatedGeometry(Braid(9.89, 1.09, 0.011), Bladder(9.28125, 0.875, 0.0625))
    >>> print(f"{virtual_work_force(muscle, 9.28125, 100.0):.0f}")  # inches, psi
    1076
    """
    return -as_real(pressure) * volume_rate(source, length, pressure, braid=braid)


class PressureTerms(eqx.Module):
    """The pressure's pull in one geometry, by Gaylord's cylinder and by virtual work.

    Attributes:
        contraction: (L0 - L) / L0 [-].
        gaylord: P pi R^2 (2 tan(theta)^2 - 1) [N].
        virtual_work: -P dV/dL [N] at constant pressure.
        virtual_work_at_thread_length: -P dV/dL [N] at constant thread length, as the work that
            stretches the threads is not the muscle's; equal to `virtual_work` where no braid was
            given.
    """

    contraction: RealArray
    gaylord: RealArray
    virtual_work: RealArray
    virtual_work_at_thread_length: RealArray


def pressure_terms(
    geometry: AbstractGeometry,
    contraction: Real,
    pressure: Real,
    *,
    braid: AbstractBraid | None = None,
) -> PressureTerms:
    """Both pressure terms over contraction: what virtual work changes.

    On the reference specimen at 100 psi, with the profiles as transcribed: 898 lbf in place of
    Gaylord's 1068 at rest, 434 for 536 at half the stroke, 127 for 107 at 35 % (905, 440 and 131 at
    constant thread length); with w from the coefficients themselves, as `famjax reproduce` takes
    it, 893 and 123 at the ends. The two decimals of the printed coefficients leave 24, 8 and 35 lbf
    (one standard deviation). Over the stroke the volume takes up 15 % less work than Gaylord's force at
    the average diameter would deliver. The tested blocked force, 1058 lbf, is nearer to Gaylord's.

    Args:
        geometry: of the muscle.
        contraction: (L0 - L) / L0 [-], a fraction.
        pressure: gauge pressure P [Pa].
        braid: the geometry's elastic braid, where it has one.

    Returns:
        The terms, of broadcast shape.
    """
    contraction, pressure = jnp.broadcast_arrays(as_real(contraction), as_real(pressure))
    length = geometry.rest_length * (1 - contraction)
    at = geometry.dimensions(length, pressure)
    return PressureTerms(
        contraction=contraction,
        gaylord=gaylord_force(pressure, at.radius, at.braid_angle),
        virtual_work=virtual_work_force(geometry, length, pressure),
        virtual_work_at_thread_length=virtual_work_force(geometry, length, pressure, braid=braid),
    )


@eqx.filter_jit
def _rates(
    source: AbstractGeometry | AbstractProfileFamily,
    length: RealArray,
    pressure: RealArray,
    braid: AbstractBraid | None,
) -> RealArray:
    """dV/dL [m2], broadcast shape."""

    def one(length: RealArray, pressure: RealArray) -> RealArray:
        volume, rate = jax.value_and_grad(_outline_volume)(length, pressure, source)
        if braid is not None:
            thread, stretch = jax.value_and_grad(braid.thread_length)(length, pressure)
            rate -= stretch * 2 * thread * volume / ((thread - length) * (thread + length))
        return rate

    return at_each(one, length, pressure)


def _outline_volume(
    length: RealArray, pressure: RealArray, source: AbstractGeometry | AbstractProfileFamily
) -> RealArray:
    """Volume [m3] within the outline at scalar length and pressure."""
    if isinstance(source, AbstractGeometry):
        return source.dimensions(length, pressure).volume
    return Meridian.of(source.at(pressure), length).volume


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
        "Pa", low=0.0, high=HIGHEST_DEADBAND, default=0.0
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
