"""A polynomial stress law in plain powers of the strain, linear in pressure."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Given, Real, RealArray, as_real
from ..parameters import number, parameter
from .abstract_material import AbstractMaterial
from .polynomial import PressurePolynomialMaterial, stresses_between_nodes


class PlainPowerMaterial(AbstractMaterial):
    """The polynomial law with plain powers, sigma = sum over n of E_n(P) eps^n, in both directions.

    Even powers pull in compression too, so that unlike `PressurePolynomialMaterial`, with which it
    shares all else, this law is not odd. In a shortening muscle the axial strain is negative.

    Attributes:
        node_pressures: [Pa], shape (nodes,), increasing, at least two.
        node_coefficients: E_n [Pa] at the nodes, shape (nodes, order).
    """

    node_pressures: Float[Given, " nodes"] = number("Pa")
    node_coefficients: Float[Given, "nodes order"] = parameter(
        "Pa", kind="stress", scale=1e6, linear=True, name="E_{1}_at_node_{0}"
    )

    directions_interact: ClassVar[bool] = False

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa]; the two directions do not interact."""
        law = PressurePolynomialMaterial(self.node_pressures, self.node_coefficients)
        return stresses_between_nodes(law, _plain_powers, axial_strain, hoop_strain, pressure)


def _plain_powers(strain: Real, order: int) -> Float[Array, "... order"]:
    return jnp.stack([as_real(strain) ** n for n in range(1, order + 1)], axis=-1)
