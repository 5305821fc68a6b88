"""Terms of a muscle's force, and their sum."""

import abc
from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from ._arrays import Given, Real, RealArray, as_real
from .braids import gaylord_force
from .geometries import Dimensions
from .materials import AbstractMaterial
from .parameters import Parametrised, parameter


class AbstractForceTerm(Parametrised):
    """One part of a muscle's force. Add terms with `+`: `PressurisedBraid() + BladderWall(material)`.

    A term uses only the dimensions of the muscle and the pressure, so it works with every geometry. Declare
    the term's parameters with `famjax.parameter` to identify them together with those of the muscle.

    Class variables:
        uses_rates: True if the term uses `at.rates`, the derivatives of the dimensions with respect to
            length.
    """

    uses_rates: ClassVar[bool] = False

    @abc.abstractmethod
    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """Return this term's force [N], with the broadcast shape; positive if it shortens the muscle.

        Args:
            at: dimensions of the muscle at its length and pressure.
            pressure: gauge pressure P [Pa].
        """

    def __add__(self, other: object) -> "SumOfTerms":
        """Return the sum of two terms."""
        if not isinstance(other, AbstractForceTerm):
            return NotImplemented
        return SumOfTerms((self, other))


class SumOfTerms(AbstractForceTerm):
    """The sum of several terms; nested sums are flattened.

    Attributes:
        terms: force terms, at least one.
    """

    terms: tuple[AbstractForceTerm, ...]

    def __init__(self, terms: Sequence[eqx.Module]) -> None:
        """Create a sum of force terms.

        Args:
            terms: force terms, at least one.

        Raises:
            ValueError: there are no terms, or an entry is not a force term.
        """
        flat: list[AbstractForceTerm] = []
        for term in terms if isinstance(terms, tuple | list) else [terms]:
            if not isinstance(term, AbstractForceTerm):
                raise ValueError(
                    "a force term must derive from famjax.terms.AbstractForceTerm and have a method "
                    f"force(at, pressure); got {type(term).__name__}. To use a bladder material, pass "
                    "famjax.terms.BladderWall(material)"
                )
            flat.extend(term.terms if isinstance(term, SumOfTerms) else [term])
        if not flat:
            raise ValueError(
                "a muscle needs at least one force term, got none: pass, for example, "
                "PressurisedBraid() + BladderWall(material)"
            )
        self.terms = tuple(flat)

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """Return the sum of the terms' forces [N], with the broadcast shape."""
        wanted = jnp.shape(at.length)
        total: Any = 0.0  # of no precision of its own
        for term in self.terms:
            force = term.force(at, pressure)
            alone = not isinstance(force, tuple | list | None)
            shape = jnp.shape(force) if alone else ()
            if not alone or jnp.broadcast_shapes(shape, wanted) != wanted:
                came = f"shape {shape}" if alone else f"a {type(force).__name__}"
                raise ValueError(
                    f"force(at, pressure) of {type(term).__name__} must return one force [N] for each "
                    f"state, in an array with the shape of at.length, {wanted}; got {came}"
                )
            total = total + force
        return jnp.asarray(total)


HIGHEST_DEADBAND = 200e3
"""Upper bound [Pa] for an identified deadband."""


class PressurisedBraid(AbstractForceTerm):
    """Gaylord's braid force, (P - P_d) pi R^2 (2 tan(theta)^2 - 1).

    Attributes:
        deadband_pressure: P_d [Pa], gauge pressure below which the muscle does not pull.

    References:
        Gaylord 1958; Chambers 2021, equation 6.1.
    """

    deadband_pressure: Float[Given, "..."] = parameter(
        "Pa", low=0.0, high=HIGHEST_DEADBAND, default=0.0
    )

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """Return the braid force [N], with the broadcast shape; negative below the neutral angle."""
        return gaylord_force(pressure - self.deadband_pressure, at.radius, at.braid_angle)


def bladder_axial_force(axial_stress: Real, bladder_volume: Real, length: Real) -> RealArray:
    """Return the force [N] due to the bladder's axial stress, sigma_z V / L.

    Args:
        axial_stress: true stress sigma_z [Pa], positive in tension.
        bladder_volume: V [m3] of the rubber.
        length: active length L [m].

    Returns:
        Force [N], with the broadcast shape; negative when the shortened bladder pushes.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """
    return jnp.asarray(axial_stress * bladder_volume / length)


def bladder_hoop_force(
    hoop_stress: Real, thickness: Real, length: Real, radius: Real, turns: Real
) -> RealArray:
    """Return the force [N] due to the bladder's hoop stress, -sigma_c t L^2 / (2 pi R N^2).

    Args:
        hoop_stress: true stress sigma_c [Pa], positive in tension.
        thickness: wall thickness t [m] of the bladder.
        length: active length L [m].
        radius: braid radius R [m].
        turns: N [-], number of turns of one thread about the axis.

    Returns:
        Force [N], with the broadcast shape; negative if the stretched bladder restrains the braid.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """
    return -jnp.asarray(hoop_stress * thickness * length**2 / (2 * jnp.pi * radius * turns**2))


def wall_forces(
    material: AbstractMaterial, at: Dimensions, pressure: Real
) -> tuple[RealArray, RealArray]:
    """Return the forces [N] due to axial and hoop stress; nan where the stress law is undefined.

    Args:
        material: stress law of the bladder.
        at: dimensions of the muscle; stresses that vary along the axis are replaced by their mean.
        pressure: gauge pressure P [Pa].

    Returns:
        (axial, hoop) forces [N], each with the broadcast shape.
    """
    stresses = material.stresses(
        at.axial_strain[..., None], at.hoop_strain, as_real(pressure)[..., None]
    )
    known = jnp.all(jnp.isfinite(stresses[0] + stresses[1]), axis=-1)
    axial, hoop = (
        jnp.sum(at.station_weights * jnp.where(known[..., None], stress, 0.0), axis=-1)
        for stress in stresses
    )
    along = bladder_axial_force(axial, at.bladder_volume, at.length)
    around = bladder_hoop_force(hoop, at.thickness, at.length, at.radius, at.turns)
    return jnp.where(known, along, jnp.nan), jnp.where(known, around, jnp.nan)


class BladderWall(AbstractForceTerm):
    """The force due to axial and hoop stress in the bladder, sigma_z V / L - sigma_c t L^2 / (2 pi R N^2).

    Stresses that vary along the axis are replaced by their axial mean.

    Attributes:
        material: stress law of the bladder.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """

    material: AbstractMaterial

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """Return the bladder's force [N], with the broadcast shape; negative where it resists."""
        axial, hoop = wall_forces(self.material, at, pressure)
        return axial + hoop


class VirtualWork(AbstractForceTerm):
    """The force due to the pressure, from virtual work: -(P - P_d) dV/dL, for any outline.

    dV/dL is the derivative, at constant pressure, of the volume computed by the geometry.

    Elastic threads store part of the work P dV. If U is their energy, F = -P dV/dL + dU/dL, and in
    equilibrium dU = P (dV/dB) dB. The force then follows from the rate at constant B,

    dV/dL - (dV/dB) dB/dL,  dV/dB = 2 B V / (B^2 - L^2),

    because the stretch scales every diameter in proportion to sqrt(B^2 - L^2).

    Attributes:
        deadband_pressure: P_d [Pa], gauge pressure below which the muscle does not pull.
        at_thread_length: True to use the rate at constant B. It has no effect if the threads are inelastic.

    References:
        Chou & Hannaford 1996.
    """

    deadband_pressure: Float[Given, "..."] = parameter(
        "Pa", low=0.0, high=HIGHEST_DEADBAND, default=0.0
    )
    at_thread_length: bool = eqx.field(static=True, default=False)

    uses_rates: ClassVar[bool] = True

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """Return the force [N] due to the pressure, with the broadcast shape.

        Raises:
            ValueError: the dimensions have no rates, or no thread length although it is required.
        """
        if at.rates is None or (self.at_thread_length and at.thread_length is None):
            raise ValueError(
                "virtual work needs the rate of change of the volume, from geometry.dimensions_with_rates; "
                "with at_thread_length, it also needs a geometry that computes the thread_length"
            )
        rate = at.rates.volume
        if self.at_thread_length:
            B, L, stretch = at.thread_length, at.length, at.rates.thread_length
            assert B is not None
            assert stretch is not None
            rate = rate - stretch * 2 * B * at.volume / ((B - L) * (B + L))
        return jnp.asarray(-(pressure - self.deadband_pressure) * rate)
