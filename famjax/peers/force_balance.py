"""Peers that are muscles of this package: a braid, a bladder, a stress law and a deadband."""

from jax.typing import ArrayLike

from .._arrays import Real, RealArray, as_real
from ..geometries import AbstractGeometry
from ..materials import MooneyRivlinMaterial, PlainPowerMaterial, PolynomialMaterial
from ..muscle import Muscle
from ..profiles import kothera_length
from .abstract_peer import PeerModel, where_it_holds


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

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        geometry = self.muscle.geometry
        radius = geometry.dimensions(length, pressure).radius
        rest_radius = geometry.dimensions(geometry.rest_length, 0.0).radius
        return self.muscle.force(kothera_length(length, radius, rest_radius), pressure)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """That of the cylindrical muscle, which is shorter than this one."""
        return self.muscle.length_range()

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""
        return self.muscle.rest_length


def hocking_wereley(
    geometry: AbstractGeometry, node_pressures: ArrayLike, node_coefficients: ArrayLike
) -> Muscle:
    """The force balance with a polynomial stress law of its own at each tested pressure.

    Args:
        geometry: in the original known, not fitted.
        node_pressures: [Pa], shape (nodes,), increasing, at least two.
        node_coefficients: E_n [Pa], shape (nodes, order), order 4 in the original.

    Returns:
        The muscle; between the nodes E_n is interpolated, and the force is nan outside them.

    References:
        Hocking & Wereley 2012. General knowledge, not read again. The powers are taken as plain
        ones; the reference work, Chambers 2021, makes the law odd.
    """
    return Muscle(geometry, PlainPowerMaterial(node_pressures, node_coefficients))


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
