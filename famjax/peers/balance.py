"""Published models based on a force balance, which combine a braid with corrections and a wall.

Published models that can be written as a `famjax.Muscle` do not need a class here. Ferraresi 2001 uses a
`PolynomialMaterial` with one coefficient, Klute & Hannaford 2000 a `MooneyRivlinMaterial`, and Robinson
2015 a `PressurePolynomialMaterial`.

To add a model, declare its parameters as fields and write a method `formula(L, P)`. Override
`length_range()` if the model is not valid from 0.5 to 1.1 times the rest length.
"""

import abc
import math

import jax
import jax.numpy as jnp
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
from ..muscle import AbstractMuscle, Muscle
from ..parameters import parameter
from ..profiles import kothera_length, tondu_lopez_length
from ..units import BAR, DEGREE, MEGAPASCAL

_ANY_PRESSURE = 1e5  # Pa, a pressure at which every model is finite


class PeerModel(AbstractMuscle):
    """A static force model of a fluidic artificial muscle, defined by a formula for its force.

    The fields are the parameters of the model in SI units. As in `famjax.Muscle`, the force is not
    clipped; where it is negative, a real muscle is slack.
    """

    @abc.abstractmethod
    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Return the force F [N] at lengths L [m] > 0 and gauge pressures P [Pa] with the same shape."""

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Return the static force F [N] at length L [m] and gauge pressure P [Pa]; arguments broadcast.

        The force is nan where the length or pressure is not finite, or the length is not positive. In
        these states, the formula is evaluated at placeholder values, because nan would contaminate the
        reverse-mode derivatives of the whole batch.
        """
        L, P = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        holds = (L > 0) & jnp.isfinite(L) & jnp.isfinite(P)
        middle = jax.lax.stop_gradient(sum(self.length_range()) / 2)
        found = self.formula(jnp.where(holds, L, middle), jnp.where(holds, P, _ANY_PRESSURE))
        return jnp.where(holds, found, jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return 0.5 and 1.1 times the rest length [m], a wider range than any muscle can reach."""
        return 0.5 * self.rest_length, 1.1 * self.rest_length


def braid_range(braid: AbstractBraid) -> tuple[RealArray, RealArray]:
    """Return the length range [m], from just below the neutral length to the unloaded thread length."""
    thread = braid.rest_thread_length
    return 0.95 * math.sin(NEUTRAL_ANGLE) * thread, thread


class Gaylord(PeerModel):
    """Force of a pressurised braid. The bladder is neglected except for a deadband and an offset.

    F = (P - P_d) (3 L^2 - B^2) / (4 pi N^2) + F_0

    This equals the force from virtual work, -(P - P_d) dV/dL + F_0, and Chou and Hannaford's model without
    a wall. With a `CompliantBraid`, it is Davis's model with elastic threads.

    Attributes:
        braid: braid around the bladder.
        deadband_pressure: P_d [Pa], zero in the original models.
        force_offset: F_0 [N], zero in the original models.
        resting_length: L0 [m], required only for the blocked force and the contraction.

    References:
        Gaylord 1958; Chou & Hannaford 1996; Davis, Tsagarakis, Canderle & Caldwell 2003. The
        formula is general knowledge and was not checked against the publications; Davis uses
        separate terms for the strand tension.

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

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m].

        Raises:
            ValueError: `resting_length` is None.
        """
        if self.resting_length is None:
            raise ValueError("the model has no rest length: set resting_length [m]")
        return self.resting_length

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Return the force F [N] at L [m] and P [Pa]."""
        acting = P - self.deadband_pressure
        L, B, reached = self.braid.reach(L, acting)
        radius = diameter_from_length(L, B, self.braid.turns) / 2
        pull = gaylord_force(acting, radius, braid_angle_from_length(L, B)) + self.force_offset
        return jnp.where(reached, pull, jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the length range [m], from just below the neutral length to the unloaded thread length."""
        return braid_range(self.braid)


class TonduLopez(PeerModel):
    """Force of the braid alone, with the contraction multiplied by k to account for rounded ends.

    F = (P - P_d) pi R0^2 (a (1 - k eps)^2 - b), k = a_k exp(-P / bar) + b_k

    with a = 3 tan(theta)^2 and b = 1 / cos(theta)^2 at the rest braid angle.

    Attributes:
        braid: threads of constant length.
        rest_length: L0 [m], reference length for the contraction eps.
        k_far: b_k [-], the value of k at high pressure.
        k_rise: a_k [-], increase in k at zero pressure.
        deadband_pressure: P_d [Pa], zero in the original model.

    References:
        Tondu & Lopez 2000. The formula is general knowledge and was not checked against the
        publication.
    """

    braid: Braid
    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    k_far: Float[Given, "..."] = parameter(low=0.5, high=3.0, default=1.0)
    k_rise: Float[Given, "..."] = parameter(low=0.0, high=20.0, default=0.0)
    deadband_pressure: Float[Given, "..."] = parameter("Pa", default=0.0)

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Return the force F [N] at L [m] and P [Pa]."""
        k = self.k_rise * jnp.exp(-P / BAR) + self.k_far
        shortened = tondu_lopez_length(L, self.rest_length, k)
        return Gaylord(self.braid, self.deadband_pressure).force(shortened, P)


class Kothera(PeerModel):
    """Force balance of the cylinder between two quarter-circle ends.

    F(L, P) = F_cylinder(L - 2 (R - R0), P), where R is the braid radius at L. The thread length in the
    ends is neglected.

    Attributes:
        muscle: cylindrical muscle, linear elastic in the original model.

    References:
        Kothera, Jangid, Sirohi & Wereley 2009. Their length formula is general knowledge; the rest of
        their algebra for the ends was not checked against the publication.
    """

    muscle: Muscle

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Return the force F [N] at L [m] and P [Pa]."""
        geometry = self.muscle.geometry
        radius = geometry.dimensions(L, P).radius
        rest_radius = geometry.dimensions(geometry.rest_length, 0.0).radius
        return self.muscle.force(kothera_length(L, radius, rest_radius), P)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the length range [m] of the cylindrical muscle, which is narrower than this model's."""
        return self.muscle.length_range()

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m], taken from the cylindrical muscle."""
        return self.muscle.rest_length


_NOMINAL_ANGLE = 28.6 * DEGREE  # thread to axis
_WALL = 1.8e-3  # m
# Bore [m], rest length [m], angle correction [rad], c0 to c3 [MPa/m^n]
_PUBLISHED = {
    "DMSP-10-250": (0.010, 0.250, -0.1, (74.085, -689.20, 1837.0, -848.79)),
    "DMSP-20-300": (0.020, 0.300, -0.073, (93.232, -715.29, 1548.3, -502.95)),
}


class Martens(PeerModel):
    """Virtual work of the pressure, plus a linear elastic wall with a modulus that is cubic in length.

    F = -P dV/dL + E (D - D0)/D0 H0 pi L dD/dL - E (L - L0)/L0 H0 pi D,
    E = c0 + c1 L + c2 L^2 + c3 L^3

    The wall thickness H0 is constant. The sign of the axial term is as printed: a shortened wall
    increases the force.

    Attributes:
        braid: inelastic braid, which determines D and dD/dL.
        rest_length: L0 [m].
        rest_diameter: D0 [m].
        wall_thickness: H0 [m].
        coefficients: c0 to c3 [Pa/m^n], shape (4,).

    References:
        Martens & Boblan 2017, Actuators 6(4). Equations, constants, bore and nominal angle are as
        transcribed in the published code of Bolen et al. 2026. The angle correction must be in radians
        to reproduce the published errors.

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
        """Create the model with published constants; its errors are up to 2.37 and 4.26 % of full force.

        Args:
            muscle: "DMSP-20-300" or "DMSP-10-250", with rest lengths of 300 and 250 mm.

        Returns:
            The model.

        Raises:
            ValueError: no constants are published for this muscle.
        """
        if muscle not in _PUBLISHED:
            raise ValueError(f"constants are available for {', '.join(_PUBLISHED)}; got {muscle!r}")
        bore, rest_length, correction, coefficients = _PUBLISHED[muscle]
        angle = math.pi / 2 - (_NOMINAL_ANGLE + correction)
        braid = Braid.from_rest(diameter=bore, braid_angle=angle, length=rest_length)
        return cls(braid, rest_length, bore, _WALL, [MEGAPASCAL * c for c in coefficients])

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Return the force F [N] at L [m] and P [Pa]."""
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
        """Return the length range [m], from just below the neutral length to the thread length."""
        return braid_range(self.braid)
