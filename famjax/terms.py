"""Force terms, and their sum."""

import abc
import functools
import operator
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ._arrays import Given, Real, RealArray, as_real, at_each, compiled
from .braids import AbstractBraid, gaylord_force
from .geometries import AbstractGeometry, Dimensions
from .materials import AbstractMaterial
from .measured import Meridian
from .parameters import Parametrised, number, parameter
from .surfaces import AbstractProfileFamily


class AbstractForceTerm(Parametrised):
    """One part of a muscle's force. Add terms by `+`: `PressurisedBraid() + BladderWall(material)`.

    A term reads the muscle's state and nothing else, so that it works in every geometry. Its own
    numbers are declared with `famjax.parameter`, to be identified with those of the muscle.

    Class variables:
        uses_rates: the term reads `at.rates`, the derivatives of the dimensions in the length.
    """

    uses_rates: ClassVar[bool] = False

    @abc.abstractmethod
    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """Force [N] of this term, broadcast shape, positive where it shortens the muscle.

        Args:
            at: dimensions of the muscle at its length and pressure.
            pressure: gauge pressure P [Pa].
        """

    def __add__(self, other: object) -> "SumOfTerms":
        """Both terms, as one sum."""
        if not isinstance(other, AbstractForceTerm):
            return NotImplemented
        return SumOfTerms((self, other))

    def __radd__(self, other: object) -> "AbstractForceTerm":
        """The term itself, added to the 0 that sum([...]) starts from."""
        return self if isinstance(other, int) and other == 0 else NotImplemented


class SumOfTerms(AbstractForceTerm):
    """Several terms, whose forces add; nested sums are flattened.

    Attributes:
        terms: one or more.
    """

    terms: tuple[AbstractForceTerm, ...]

    def __init__(self, terms: Sequence[eqx.Module]) -> None:
        """See the class.

        Args:
            terms: force terms, one or more.

        Raises:
            ValueError: there is no term, or something else among them.
        """
        flat: list[AbstractForceTerm] = []
        for term in terms if isinstance(terms, tuple | list) else [terms]:
            if not isinstance(term, AbstractForceTerm):
                raise ValueError(
                    "a force term is derived from famjax.terms.AbstractForceTerm and has the method "
                    f"force(at, pressure); got {type(term).__name__}. A bladder material becomes a "
                    "term by famjax.terms.BladderWall(material)"
                )
            flat.extend(term.terms if isinstance(term, SumOfTerms) else [term])
        if not flat:
            raise ValueError(
                "a muscle needs at least one force term, got none: give, for instance, "
                "PressurisedBraid() + BladderWall(material)"
            )
        self.terms = tuple(flat)

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The sum of the terms' forces [N], broadcast shape."""
        forces = [_of_term(term, at, pressure) for term in self.terms]
        return functools.reduce(operator.add, forces)


def _of_term(term: AbstractForceTerm, at: Dimensions, pressure: Real) -> RealArray:
    """The force of a term [N].

    Raises:
        ValueError: it is not one number for each state.
    """
    force = term.force(at, pressure)
    wanted = jnp.shape(at.length)
    shape = force.shape if isinstance(force, jax.Array | np.ndarray) else np.shape(force)
    alone = not isinstance(force, tuple | list | None)
    if not alone or len(shape) > len(wanted) or jnp.broadcast_shapes(shape, wanted) != wanted:
        came = f"the shape {shape}" if alone else f"a {type(force).__name__}"
        raise ValueError(
            f"force(at, pressure) of {type(term).__name__} must return one force [N] for each state, "
            f"here of the shape {wanted}, that of at.length; got {came}"
        )
    return jnp.asarray(force)


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


def bladder_axial_force(axial_stress: Real, bladder_volume: Real, length: Real) -> RealArray:
    """Pull [N] of the bladder's own axial stress, sigma_z V / L.

    Args:
        axial_stress: true stress sigma_z [Pa], positive in tension.
        bladder_volume: V [m3] of the rubber.
        length: active length L [m].

    Returns:
        Force [N], broadcast shape; negative when the shortened bladder pushes.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """
    return jnp.asarray(axial_stress * bladder_volume / length)


def bladder_hoop_force(
    hoop_stress: Real, thickness: Real, length: Real, radius: Real, turns: Real
) -> RealArray:
    """Force [N] of the bladder's hoop stress, -sigma_c t L^2 / (2 pi R N^2).

    Args:
        hoop_stress: true stress sigma_c [Pa], positive in tension.
        thickness: wall t [m].
        length: active length L [m].
        radius: braid radius R [m].
        turns: N [-].

    Returns:
        Force [N], broadcast shape; negative when the stretched bladder holds the braid back.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """
    return -jnp.asarray(hoop_stress * thickness * length**2 / (2 * jnp.pi * radius * turns**2))


def _wall_forces(
    material: AbstractMaterial, at: Dimensions, pressure: Real
) -> tuple[RealArray, RealArray]:
    """Pulls [N] of the axial means of axial and hoop stress; nan where the law knows no stress."""
    stresses = material.stresses(
        at.axial_strain[..., None], at.hoop_strain, as_real(pressure)[..., None]
    )
    known = jnp.all(jnp.isfinite(stresses[0] + stresses[1]), axis=-1)
    axial, hoop = (
        jnp.sum(at.station_weights * jnp.where(known[..., None], stress, 0.0), axis=-1)
        for stress in stresses
    )
    pulls = (
        bladder_axial_force(axial, at.bladder_volume, at.length),
        bladder_hoop_force(hoop, at.thickness, at.length, at.radius, at.turns),
    )
    return jnp.where(known, pulls[0], jnp.nan), jnp.where(known, pulls[1], jnp.nan)


class BladderAxial(AbstractForceTerm):
    """The pull of the axial stress alone, sigma_z V / L.

    Attributes:
        material: stress law of the bladder.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """

    material: AbstractMaterial

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The pull [N], broadcast shape; negative where the shortened bladder pushes."""
        return _wall_forces(self.material, at, pressure)[0]


class BladderHoop(AbstractForceTerm):
    """The pull lost to the hoop stress alone, -sigma_c t L^2 / (2 pi R N^2).

    Attributes:
        material: stress law of the bladder.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """

    material: AbstractMaterial

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The pull [N], broadcast shape; negative where the stretched bladder holds the braid."""
        return _wall_forces(self.material, at, pressure)[1]


class BladderWall(AbstractForceTerm):
    """Both parts of the bladder, of one material: sigma_z V / L - sigma_c t L^2 / (2 pi R N^2).

    Stresses that vary along the axis enter by their axial mean.

    Attributes:
        material: stress law of the bladder.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """

    material: AbstractMaterial

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The bladder's pull [N], broadcast shape; negative where it resists."""
        axial, hoop = _wall_forces(self.material, at, pressure)
        return axial + hoop


def volume_rate(
    source: AbstractGeometry | AbstractProfileFamily,
    length: Real,
    pressure: Real,
    *,
    braid: AbstractBraid | None = None,
) -> RealArray:
    """Derivative of the outline's volume with respect to length, dV/dL [m2], negative where a muscle pulls.

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


@compiled
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


def smooth_sign(velocity: Real, reference_velocity: Real) -> RealArray:
    """Direction of motion in [-1, 1], tanh(v / v_ref): the sign, without its jump at rest.

    Args:
        velocity: dL/dt [m/s], positive when the muscle lengthens.
        reference_velocity: v_ref [m/s], > 0; at three times this the sign is 0.995.

    Returns:
        Direction [-], broadcast shape.
    """
    return jnp.tanh(as_real(velocity) / reference_velocity)


def thread_contact_area(rest_area: Real, rest_braid_angle: Real, braid_angle: Real) -> RealArray:
    """Area S [m2] in which threads touch threads, S = S0 sin(2 theta0) / sin(2 theta).

    Threads of constant width cross in rhombi, whose number stays and whose area goes with
    1 / sin(2 theta): smallest at 45 deg. The threads are taken as flat ribbons that do not jam.

    Args:
        rest_area: S0 [m2] at rest; 2 pi R0 L0 for a braid that covers the bladder.
        rest_braid_angle: theta0 [rad], in (0, pi/2); the angle to the axis does as well.
        braid_angle: theta [rad], measured alike.

    Returns:
        S [m2], broadcast shape.

    References:
        Tondu & Lopez 2000, IEEE Control Systems Magazine 20(2); see `ThreadFriction`.
    """
    return jnp.asarray(rest_area * jnp.sin(2 * rest_braid_angle) / jnp.sin(2 * braid_angle))


class AbstractFriction(Parametrised):
    """A friction term: an amplitude that the direction of motion multiplies."""

    @abc.abstractmethod
    def amplitude(self, at: Dimensions, pressure: Real) -> RealArray:
        """Friction [N] of full sliding, half the width of the loop, broadcast shape.

        Args:
            at: dimensions of the muscle; ignored by terms that do not depend on them.
            pressure: gauge pressure P [Pa].
        """

    def force(self, at: Dimensions, pressure: Real, direction: Real) -> RealArray:
        """Friction force F_fr [N], broadcast shape; positive when lengthening.

        Args:
            at: dimensions of the muscle, `geometry.dimensions(length, pressure)`.
            pressure: gauge pressure P [Pa].
            direction: in [-1, 1], 1 when the muscle lengthens; `smooth_sign` of a velocity.
        """
        return jnp.asarray(direction * self.amplitude(at, pressure))


class ThreadFriction(AbstractFriction):
    """Dry friction of thread on thread, F_fr = f_s S P, S by `thread_contact_area`.

    The coefficient is constant. Tondu and Lopez let it fall with speed from a static to a kinetic
    value; in quasi-static motion only one of the two acts.

    Attributes:
        coefficient: f_s [-], >= 0.
        rest_area: S0 [m2], contact area at rest; 2 pi R0 L0 for a braid that covers the bladder.
            Only f_s S0 can be identified from a force.
        rest_braid_angle: theta0 [rad].

    References:
        Tondu & Lopez 2000, IEEE Control Systems Magazine 20(2). The form was taken from general
        knowledge and agrees with public code that follows them; to be checked against the
        original before it is cited.
    """

    coefficient: Float[Given, "..."] = parameter(low=0.0, linear=True, name="friction_coefficient")
    rest_area: Float[Given, "..."] = number("m2")
    rest_braid_angle: Float[Given, "..."] = number("rad")

    def amplitude(self, at: Dimensions, pressure: Real) -> RealArray:
        """Friction [N] of full sliding, f_s S(theta) P, broadcast shape."""
        area = thread_contact_area(self.rest_area, self.rest_braid_angle, at.braid_angle)
        return self.coefficient * area * pressure


class PressureFriction(AbstractFriction):
    """Friction of a constant plus a part that grows with pressure, F_fr = c0 + c1 P.

    Attributes:
        constant: c0 [N].
        per_pressure: c1 [m2], force per pressure.
    """

    constant: Float[Given, "..."] = parameter("N", linear=True, name="friction_constant")
    per_pressure: Float[Given, "..."] = parameter("m2", linear=True, name="friction_per_pressure")

    def amplitude(self, at: Dimensions, pressure: Real) -> RealArray:
        """Friction [N] of full sliding, c0 + c1 P, broadcast shape."""
        shape = jnp.broadcast_shapes(jnp.shape(at.length), jnp.shape(pressure))
        return jnp.broadcast_to(self.constant + self.per_pressure * pressure, shape)


class Friction(AbstractForceTerm):
    """Friction force of a moving muscle: the amplitude of a law times a direction.

    Attributes:
        law: its amplitude, such as a `ThreadFriction` or a `PressureFriction`.
        direction: in [-1, 1], 1 when the muscle lengthens, -1 when it shortens; `smooth_sign` of a
            velocity.

    >>> import famjax
    >>> shortening = Friction(famjax.terms.PressureFriction(8.0, 6e-5), -1.0)
    """

    law: AbstractFriction
    direction: Float[Given, "..."] = number()

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """Friction force [N], broadcast shape; positive when lengthening."""
        return self.law.force(at, pressure, self.direction)


class Spring(AbstractForceTerm):
    """A linear spring parallel to the muscle, F = F_0 + k (L - L_s).

    Attributes:
        stiffness: k [N/m], >= 0; a stretched spring pulls with the muscle.
        rest_length: L_s [m], active length of the muscle at which the spring pulls with F_0 only.
            Only F_0 - k L_s can be identified from a force.
        preload: F_0 [N].
    """

    stiffness: Float[Given, "..."] = parameter("N/m", low=0.0)
    rest_length: Float[Given, "..."] = parameter("m", low=0.0, name="spring_length")
    preload: Float[Given, "..."] = parameter("N", linear=True, name="spring_preload", default=0.0)

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The spring's pull [N], broadcast shape; negative where it is compressed."""
        shape = jnp.broadcast_shapes(jnp.shape(at.length), jnp.shape(pressure))
        pull = self.preload + self.stiffness * (at.length - self.rest_length)
        return jnp.broadcast_to(pull, shape)
