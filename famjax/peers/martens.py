"""Martens and Boblan's force balance with a modulus that depends on the length."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._arrays import Given, Real, RealArray
from ..braids import Braid
from ..parameters import parameter
from ..units import DEGREE, MEGAPASCAL
from .abstract_peer import PeerModel, braid_range, where_it_holds
from .braid_alone import Gaylord

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
    def from_rest(
        cls,
        *,
        diameter: Real,
        braid_angle: Real,
        length: Real,
        wall_thickness: Real,
        coefficients: Float[Array, " 4"] | tuple[float, ...],
    ) -> "Martens":
        """The model whose braid has this diameter and angle at rest.

        Args:
            diameter: D0 [m].
            braid_angle: theta0 [rad], from the circumference.
            length: L0 [m].
            wall_thickness: H0 [m].
            coefficients: c0 to c3 [Pa/m^n].

        Returns:
            The model.
        """
        braid = Braid.from_rest(diameter=diameter, braid_angle=braid_angle, length=length)
        return cls(braid, length, diameter, wall_thickness, coefficients)

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
        return cls.from_rest(
            diameter=bore,
            braid_angle=math.pi / 2 - (_NOMINAL_ANGLE + correction),
            length=rest_length,
            wall_thickness=_WALL,
            coefficients=tuple(MEGAPASCAL * c for c in coefficients),
        )

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        L, _, reached = self.braid.reach(length, pressure)
        L0, D0 = self.rest_length, self.rest_diameter
        D = self.braid.diameter(L)
        slope = -L / ((jnp.pi * self.braid.turns) ** 2 * D)
        c0, c1, c2, c3 = self.coefficients
        E = c0 + L * (c1 + L * (c2 + L * c3))
        hoop = E * (D - D0) / D0 * self.wall_thickness * jnp.pi * L
        axial = E * (L - L0) / L0 * self.wall_thickness * jnp.pi * D
        pull = Gaylord(self.braid).force(L, pressure) + hoop * slope - axial
        return jnp.where(reached, pull, jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From just below the neutral angle to the length of the threads."""
        return braid_range(self.braid)
