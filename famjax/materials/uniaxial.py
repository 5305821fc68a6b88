"""Stress laws of a single direction: axial and hoop stress do not interact."""

import abc
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._types import Given, Real, RealArray, as_real
from ..parameters import parameter
from .abstract_material import AbstractMaterial
from .hyperelastic import STRESS_SCALE, derivative

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


class AbstractUniaxialLaw(AbstractMaterial):
    """A law whose two directions do not interact: true stress against its own strain alone.

    The law is given by a potential phi(eps) with sigma = dphi/deps, its integral over engineering
    strain. As sigma is a true stress, the energy stored is another integral, W in `energy`.
    """

    directions_interact: ClassVar[bool] = False
    depends_on_pressure: ClassVar[bool] = False

    @abc.abstractmethod
    def potential(self, strain: Real) -> RealArray:
        """Potential phi [Pa] of one direction at engineering strain eps [-], phi(0) = 0."""

    def stress(self, strain: Real) -> RealArray:
        """True stress sigma = dphi/deps [Pa] of one direction at engineering strain eps [-]."""
        return derivative(self.potential, as_real(strain))

    def tangent_modulus(self, strain: Real) -> RealArray:
        """Tangent modulus dsigma/deps [Pa] at engineering strain eps [-]."""
        return derivative(self.stress, as_real(strain))

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa]; the two directions do not interact."""
        del pressure
        return self.stress(axial_strain), self.stress(hoop_strain)

    def energy(self, axial_stretch: Real, hoop_stretch: Real) -> RealArray:
        """Energy W [J/m3] per volume, the sum over both directions of int sigma dlambda / lambda.

        Gauss-Legendre quadrature with 32 nodes from the unstrained state.

        Args:
            axial_stretch: lambda_z [-], > 0.
            hoop_stretch: lambda_c [-], > 0.

        Returns:
            W [J/m3], broadcast shape.
        """

        def one(strain: RealArray) -> RealArray:
            part = strain[..., None] * np.asarray((1 + _NODES) / 2, strain.dtype)
            weights = np.asarray(_WEIGHTS / 2, strain.dtype)
            return strain * jnp.sum(weights * self.stress(part) / (1 + part), axis=-1)

        return one(as_real(axial_stretch) - 1) + one(as_real(hoop_stretch) - 1)


class SaturatingMaterial(AbstractUniaxialLaw):
    """The two-term saturating law: a stiff start that softens to a constant modulus; odd.

    sigma = E_inf eps + S (1 - exp(-|eps|/s)) sign(eps)

    Attributes:
        final_modulus: E_inf [Pa], tangent modulus at large strain.
        saturation_stress: S [Pa], to which the second term rises.
        strain_scale: s [-], > 0, strain over which it does.

    >>> law = SaturatingMaterial(2e5, 1e5, 0.2)
    >>> print(f"{law.stress(0.0):.0f} {law.tangent_modulus(0.0):.0f}")
    0 700000
    """

    final_modulus: Float[Given, "..."] = parameter(
        "Pa", kind="stress", low=0.0, scale=STRESS_SCALE, linear=True
    )
    saturation_stress: Float[Given, "..."] = parameter(
        "Pa", kind="stress", low=0.0, scale=STRESS_SCALE, linear=True
    )
    strain_scale: Float[Given, "..."] = parameter(low=2e-3, high=0.5)

    law_name: ClassVar[str] = "saturating"

    def potential(self, strain: Real) -> RealArray:
        """Potential phi [Pa], E_inf eps^2/2 + S (|eps| + s (exp(-|eps|/s) - 1))."""
        eps, s = as_real(strain), self.strain_scale
        # Not jnp.abs: its derivative at zero is zero, and the tangent modulus there would be E_inf.
        size = jnp.where(eps >= 0, eps, -eps)
        saturating = size + s * jnp.expm1(-size / s)
        return self.final_modulus * eps**2 / 2 + self.saturation_stress * saturating

    def stress(self, strain: Real) -> RealArray:
        """True stress sigma [Pa] of one direction at engineering strain eps [-]."""
        eps = as_real(strain)
        sign = jnp.where(eps >= 0, 1.0, -1.0)
        rising = -sign * jnp.expm1(-sign * eps / self.strain_scale)
        return self.final_modulus * eps + self.saturation_stress * rising

    @property
    def initial_modulus(self) -> RealArray:
        """Tangent modulus [Pa] at zero strain, E_inf + S/s."""
        return self.final_modulus + self.saturation_stress / self.strain_scale
