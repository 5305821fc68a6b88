"""Published models by force balance: the braid, with corrections, walls and bladder laws.

A new one has its parameters as fields and `formula(L, P)`; `length_range()` where half to 1.1 of the rest
length is not where it holds.
"""

import abc
import math

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Float

from .._arrays import Given, Real, RealArray, as_real
from ..braids import (
    NEUTRAL_ANGLE,
    AbstractBraid,
    Braid,
    braid_angle_from_length,
    diameter_from_length,
    gaylord_force,
)
from ..geometries import AbstractGeometry
from ..materials import MooneyRivlinMaterial, PlainPowerMaterial, PolynomialMaterial
from ..muscle import AbstractMuscle, Muscle
from ..parameters import parameter
from ..profiles import kothera_length, tondu_lopez_length
from ..units import BAR, DEGREE, MEGAPASCAL

_ANY_PRESSURE = 1e5  # Pa, at which every model has a force


class PeerModel(AbstractMuscle):
    """A static force model of a fluidic artificial muscle, by a formula for its pull.

    The fields are its parameters, in SI. As with `famjax.Muscle`, the force is not clipped: a
    negative one means that a real muscle is slack.
    """

    @abc.abstractmethod
    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Pull F [N] at lengths L [m] > 0 and gauge pressures P [Pa], numbers of one shape."""

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape.

        Nan where length or pressure are no numbers, or the length is not positive. The formula is asked
        of other numbers there: nan itself would spoil, in reverse mode, the derivatives of all other
        members of a batch.
        """
        L, P = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        holds = (L > 0) & jnp.isfinite(L) & jnp.isfinite(P)
        middle = jax.lax.stop_gradient(sum(self.length_range()) / 2)
        found = self.formula(jnp.where(holds, L, middle), jnp.where(holds, P, _ANY_PRESSURE))
        return jnp.where(holds, found, jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From half the rest length [m] to a tenth above it: beyond what muscles do."""
        return 0.5 * self.rest_length, 1.1 * self.rest_length


class WithoutRestLength(PeerModel):
    """A model whose force needs no rest length; blocked force and contraction do."""

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction.

        Raises:
            ValueError: it was not given.
        """
        rest: RealArray | None = self.resting_length  # pyright: ignore -- a field of each of them
        if rest is None:
            raise ValueError(
                f"the force of {type(self).__name__} knows no rest length, so that it has neither a "
                "blocked force nor a contraction; give it resting_length [m]"
            )
        return rest


def braid_range(braid: AbstractBraid) -> tuple[RealArray, RealArray]:
    """From just below the neutral angle to the length [m] of the unloaded threads."""
    thread = braid.rest_thread_length
    return 0.95 * math.sin(NEUTRAL_ANGLE) * thread, thread


class Gaylord(WithoutRestLength):
    """The pull of a pressurised braid; the bladder is neglected except for a deadband and an offset.

    F = (P - P_d) (3 L^2 - B^2) / (4 pi N^2) + F_0

    This is also virtual work, -(P - P_d) dV/dL + F_0, and Chou and Hannaford's model without wall.
    With a `CompliantBraid` it is Davis' model of threads that stretch.

    Attributes:
        braid: threads about the bladder.
        deadband_pressure: P_d [Pa], zero in the originals.
        force_offset: F_0 [N], zero in the originals.
        resting_length: L0 [m], which the force does not need; blocked force and contraction do.

    References:
        Gaylord 1958; Chou & Hannaford 1996; Davis, Tsagarakis, Canderle & Caldwell 2003. General
        knowledge, not read again: Davis takes the tension of a strand from terms of its own.

    >>> model = Gaylord(Braid.from_rest(diameter=0.02, braid_angle=1.1, length=0.3))
    >>> print(f"{model.force(0.3, 6e5):.0f}")
    1267
    """

    braid: AbstractBraid
    deadband_pressure: Float[Given, "..."] = parameter("Pa", default=0.0)
    force_offset: Float[Given, "..."] = parameter("N", linear=True, default=0.0)
    resting_length: Float[Given, "..."] | None = parameter(
        "m", low=0.0, name="rest_length", default=None
    )

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Pull F [N] at L [m] and P [Pa]."""
        acting = P - self.deadband_pressure
        L, B, reached = self.braid.reach(L, acting)
        radius = diameter_from_length(L, B, self.braid.turns) / 2
        pull = gaylord_force(acting, radius, braid_angle_from_length(L, B)) + self.force_offset
        return jnp.where(reached, pull, jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From just below the neutral angle to the length of the unloaded threads."""
        return braid_range(self.braid)


class ChouHannaford(WithoutRestLength):
    """The braid around a wall of constant thickness that does not resist.

    F = pi D^2 P / 4 (3 cos(a)^2 - 1) + pi P (D t (2 sin(a) - 1 / sin(a)) - t^2), cos(a) = L / B

    with D = B / (pi N), the diameter at 90 deg, and a the angle between thread and axis.

    Attributes:
        braid: threads of constant length.
        wall_thickness: t [m] of braid and bladder together.
        resting_length: L0 [m], which the force does not need; blocked force and contraction do.

    References:
        Chou & Hannaford 1996. General knowledge, not read again.
    """

    braid: Braid
    wall_thickness: Float[Given, "..."] = parameter("m", low=0.0)
    resting_length: Float[Given, "..."] | None = parameter(
        "m", low=0.0, name="rest_length", default=None
    )

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Pull F [N] at L [m] and P [Pa]."""
        L, B, reached = self.braid.reach(L, P)
        t = self.wall_thickness
        D = B / (jnp.pi * self.braid.turns)
        sine = jnp.sqrt((B - L) * (B + L)) / B
        wall = jnp.pi * P * (D * t * (2 * sine - 1 / sine) - t**2)
        return jnp.where(reached, Gaylord(self.braid).force(L, P) + wall, jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From just below the neutral angle to the length of the threads."""
        return braid_range(self.braid)


class TonduLopez(PeerModel):
    """The braid alone at a contraction multiplied by k, for ends that are not cylindrical.

    F = (P - P_d) pi R0^2 (a (1 - k eps)^2 - b), k = a_k exp(-P / bar) + b_k

    with a = 3 tan(theta)^2 and b = 1 / cos(theta)^2 of the braid angle at rest.

    Attributes:
        braid: threads of constant length.
        rest_length: L0 [m], from which the contraction eps is counted.
        k_far: b_k [-], the value at high pressure; the constant k where `k_rise` is zero.
        k_rise: a_k [-], by which k is greater without pressure.
        deadband_pressure: P_d [Pa], zero in the original.

    References:
        Tondu & Lopez 2000. General knowledge, not read again.
    """

    braid: Braid
    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    k_far: Float[Given, "..."] = parameter(low=0.5, high=3.0, default=1.0)
    k_rise: Float[Given, "..."] = parameter(low=0.0, high=20.0, default=0.0)
    deadband_pressure: Float[Given, "..."] = parameter("Pa", default=0.0)

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Pull F [N] at L [m] and P [Pa]."""
        k = self.k_rise * jnp.exp(-P / BAR) + self.k_far
        shortened = tondu_lopez_length(L, self.rest_length, k)
        return Gaylord(self.braid, self.deadband_pressure).force(shortened, P)


def ferraresi(geometry: AbstractGeometry, modulus: Real, deadband_pressure: Real = 0.0) -> Muscle:
    """The force balance with a linear elastic bladder, sigma = E eps in both directions.

    Args:
        geometry: usually an `EstimatedGeometry`.
        modulus: E [Pa].
        deadband_pressure: P_d [Pa], zero in the original.

    Returns:
        The muscle.

    References:
        Ferraresi, Franco & Manuello Bertetto 2001. General knowledge, not read again.
    """
    return Muscle(geometry, PolynomialMaterial(as_real(modulus)[None]), deadband_pressure)


class Kothera(PeerModel):
    """A force balance evaluated at the length of the part between two quarter-circle ends.

    F(L, P) = F_cylinder(L - 2 (R - R0), P), R the braid's radius at L. That the ends take up some
    of the thread is neglected.

    Attributes:
        muscle: the cylindrical one, in the original linear elastic.

    References:
        Kothera, Jangid, Sirohi & Wereley 2009. The length is theirs from general knowledge; the
        rest of their algebra for the ends was not read again.
    """

    muscle: Muscle

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Pull F [N] at L [m] and P [Pa]."""
        geometry = self.muscle.geometry
        radius = geometry.dimensions(L, P).radius
        rest_radius = geometry.dimensions(geometry.rest_length, 0.0).radius
        return self.muscle.force(kothera_length(L, radius, rest_radius), P)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Length range [m] of the cylindrical muscle, which is shorter than this one."""
        return self.muscle.length_range()

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""
        return self.muscle.rest_length


def robinson(
    geometry: AbstractGeometry,
    pressures: ArrayLike,
    coefficients: ArrayLike,
    deadband_pressure: Real = 0.0,
) -> Muscle:
    """The force balance with polynomial coefficients that are linear in pressure.

    Args:
        geometry: usually an `EstimatedGeometry`.
        pressures: two pressures [Pa] at which the coefficients are given, increasing.
        coefficients: E_n [Pa] there, shape (2, order); positive in the originals.
        deadband_pressure: P_d [Pa], zero in the originals.

    Returns:
        The muscle.

    References:
        Robinson, Kothera & Wereley 2015; Pillsbury et al. 2015. General knowledge, not read
        again; the powers are taken as plain ones.
    """
    return Muscle(geometry, PlainPowerMaterial(pressures, coefficients), deadband_pressure)


def klute_hannaford(
    geometry: AbstractGeometry, c10: Real, c01: Real, deadband_pressure: Real = 0.0
) -> Muscle:
    """The pressure's virtual work and a Mooney-Rivlin bladder, F = -(P - P_d) dV/dL + V_b dW/dL.

    With the threads embedded in the wall the force balance is exactly this.

    Args:
        geometry: usually an `EstimatedGeometry`.
        c10: C10 [Pa].
        c01: C01 [Pa].
        deadband_pressure: P_d [Pa], zero in the originals.

    Returns:
        The muscle.

    References:
        Klute & Hannaford 2000; Meller, Chipka, Volkov, Bryant & Garcia 2014. General knowledge.
    """
    return Muscle(geometry, MooneyRivlinMaterial(c10, c01), deadband_pressure)


_NOMINAL_ANGLE = 28.6 * DEGREE  # thread to axis
_WALL = 1.8e-3  # m
# Bore [m], rest length [m], angle correction [rad], c0 to c3 [MPa/m^n]
_PUBLISHED = {
    "DMSP-10-250": (0.010, 0.250, -0.1, (74.085, -689.20, 1837.0, -848.79)),
    "DMSP-20-300": (0.020, 0.300, -0.073, (93.232, -715.29, 1548.3, -502.95)),
}


class Martens(PeerModel):
    """Virtual work of the pressure and a linear elastic wall whose modulus is a cubic of length.

    F = -P dV/dL + E (D - D0)/D0 H0 pi L dD/dL - E (L - L0)/L0 H0 pi D,
    E = c0 + c1 L + c2 L^2 + c3 L^3

    The wall H0 keeps its thickness, and the sign of the axial term is the printed one: a shortened
    wall adds to the pull.

    Attributes:
        braid: threads of constant length, D and dD/dL.
        rest_length: L0 [m].
        rest_diameter: D0 [m].
        wall_thickness: H0 [m].
        coefficients: c0 to c3 [Pa/m^n], shape (4,).

    References:
        Martens & Boblan 2017, Actuators 6(4). Equations, constants, bore and nominal angle as
        transcribed in the published code of Bolen et al. 2026. The angle correction is in radians:
        only so do the constants return the published errors.

    >>> print(f"{Martens.published('DMSP-20-300').force(0.282, 6e5):.0f}")  # measured: 1004 N
    1022
    """

    braid: Braid
    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    rest_diameter: Float[Given, "..."] = parameter("m", low=0.0)
    wall_thickness: Float[Given, "..."] = parameter("m", low=0.0)
    coefficients: Float[Given, " 4"] = parameter(
        ("Pa", "Pa/m", "Pa/m2", "Pa/m3"), linear=True, name=("c0", "c1", "c2", "c3")
    )

    @classmethod
    def published(cls, muscle: str) -> "Martens":
        """The published constants: 2.37 and 4.26 % of the largest measured force at worst.

        Args:
            muscle: "DMSP-20-300" or "DMSP-10-250", with rest lengths of 300 and 250 mm.

        Returns:
            The model.

        Raises:
            ValueError: no constants are known for that muscle.
        """
        if muscle not in _PUBLISHED:
            raise ValueError(
                f"Martens' constants are known for {', '.join(_PUBLISHED)}; got {muscle!r}"
            )
        bore, rest_length, correction, coefficients = _PUBLISHED[muscle]
        angle = math.pi / 2 - (_NOMINAL_ANGLE + correction)
        braid = Braid.from_rest(diameter=bore, braid_angle=angle, length=rest_length)
        return cls(braid, rest_length, bore, _WALL, [MEGAPASCAL * c for c in coefficients])

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Pull F [N] at L [m] and P [Pa]."""
        L, _, reached = self.braid.reach(L, P)
        L0, D0 = self.rest_length, self.rest_diameter
        D = self.braid.diameter(L)
        slope = -L / ((jnp.pi * self.braid.turns) ** 2 * D)
        c0, c1, c2, c3 = self.coefficients
        E = c0 + L * (c1 + L * (c2 + L * c3))
        hoop = E * (D - D0) / D0 * self.wall_thickness * jnp.pi * L
        axial = E * (L - L0) / L0 * self.wall_thickness * jnp.pi * D
        pull = Gaylord(self.braid).force(L, P) + hoop * slope - axial
        return jnp.where(reached, pull, jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From just below the neutral angle to the length of the threads."""
        return braid_range(self.braid)
