"""A polynomial stress law in plain powers of the strain, linear in pressure."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._material import AbstractMaterial, PressurePolynomialMaterial
from .._types import Real, RealArray, as_real


class PlainPowerMaterial(AbstractMaterial):
    """The polynomial law with plain powers, sigma = sum over n of E_n(P) eps^n, in both directions.

    Even powers pull in compression too, so that unlike `PressurePolynomialMaterial`, with which it
    shares all else, this law is not odd. In a shortening muscle the axial strain is negative.

    Attributes:
        node_pressures: [Pa], shape (nodes,), increasing, at least two.
        node_coefficients: E_n [Pa] at the nodes, shape (nodes, order).
    """

    node_pressures: Float[Array, " nodes"] = eqx.field(converter=as_real)
    node_coefficients: Float[Array, "nodes order"] = eqx.field(converter=as_real)

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa]; the two directions do not interact."""
        law = PressurePolynomialMaterial(self.node_pressures, self.node_coefficients)
        coefficients = law.coefficients_at(pressure)
        orders = range(1, coefficients.shape[-1] + 1)

        def stress(strain: Real) -> RealArray:
            powers = jnp.stack([as_real(strain) ** n for n in orders], axis=-1)
            return jnp.sum(powers * coefficients, axis=-1)

        return stress(axial_strain), stress(hoop_strain)
