"""Polynomial stress laws, the coefficients fixed or varying with the pressure."""

from collections.abc import Callable
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._types import Given, Real, RealArray, as_real
from ..parameters import number, parameter
from .abstract_material import AbstractMaterial

_STRESS = 1e6  # Pa


def odd_powers(strain: Real, order: int) -> Float[Array, "... order"]:
    """The odd powers sign(eps) |eps|^n for n = 1 to `order`, smooth enough for gradients at zero.

    Args:
        strain: eps [-].
        order: highest power, >= 1.

    Returns:
        Array of shape (..., order): a stress law is this, times E_n, summed.

    >>> [round(float(value), 3) for value in odd_powers(-0.2, 3)]
    [-0.2, -0.04, -0.008]
    """
    eps = as_real(strain)
    powers = [eps]
    for _ in range(order - 1):
        powers.append(powers[-1] * jnp.abs(eps))
    return jnp.stack(powers, axis=-1)


class PolynomialMaterial(AbstractMaterial):
    """The reference work's law, sigma = sum over n of E_n sign(eps) |eps|^n, in both directions.

    Attributes:
        coefficients: E_n [Pa], shape (order,).

    References:
        Hocking & Wereley 2012; Chambers 2021, equation 7.1.

    >>> latex = PolynomialMaterial([257.8, -57.9, 32.7])  # psi: Chambers 2021, chapter 6
    >>> print(f"{latex.stress(1.0):.1f} {latex.stress(-1.0):.1f}")
    232.6 -232.6
    """

    coefficients: Float[Given, " order"] = parameter(
        "Pa", kind="stress", scale=_STRESS, linear=True, name="E_{}"
    )

    directions_interact: ClassVar[bool] = False
    depends_on_pressure: ClassVar[bool] = False
    law_name: ClassVar[str] = "polynomial"

    def __check_init__(self) -> None:
        """Refuse coefficients that are not one row."""
        shape = np.shape(self.coefficients)
        if len(shape) != 1 or not shape[0]:
            raise ValueError(
                f"the coefficients E_1, E_2, ... must be one row of shape (order,), got shape {shape}: for "
                "many laws at once make each within jax.vmap"
            )

    @classmethod
    def template(cls, *, order: int = 3, **fields: Any) -> "PolynomialMaterial":
        """The law of this order, by default the cubic one."""
        fields.setdefault("coefficients", np.full(order, _STRESS))
        return super().template(**fields)

    def stress(self, strain: Real) -> RealArray:
        """True stress sigma [Pa] at engineering strain eps [-]; odd, sigma(-eps) = -sigma(eps)."""
        return odd_powers(strain, self.coefficients.shape[-1]) @ self.coefficients

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa]; the two directions do not interact."""
        del pressure
        return self.stress(axial_strain), self.stress(hoop_strain)


class PressurePolynomialMaterial(AbstractMaterial):
    """The polynomial law with coefficients that depend on pressure, given at pressure nodes.

    Between nodes E_n is interpolated linearly. With two nodes the law is linear in pressure and
    holds outside them too; with more it is known at the nodes' range only, and nan outside.

    Attributes:
        node_pressures: [Pa], shape (nodes,), increasing, at least two.
        node_coefficients: E_n [Pa] at the nodes, shape (nodes, order).

    References:
        Robinson et al. 2015; Chambers 2021, section 7.1.
    """

    node_pressures: Float[Given, " nodes"] = number("Pa")
    node_coefficients: Float[Given, "nodes order"] = parameter(
        "Pa", kind="stress", scale=_STRESS, linear=True, name="E_{1}_at_node_{0}"
    )

    directions_interact: ClassVar[bool] = False

    def __check_init__(self) -> None:
        if self.node_pressures.shape[0] < 2:
            raise ValueError(
                "a pressure-dependent law needs at least two node pressures, got "
                f"{self.node_pressures.shape[0]}; use PolynomialMaterial for one"
            )

    def coefficients_at(self, pressure: Real) -> Float[Array, "... order"]:
        """Coefficients E_n [Pa] at gauge pressure P [Pa], shape (..., order)."""
        at = as_real(pressure)
        return jnp.where(self.known(at)[..., None], self.interpolated(at), jnp.nan)

    def known(self, pressure: Real) -> Bool[Array, "..."]:
        """Whether the law is known at gauge pressure P [Pa]: between the nodes, or two of them."""
        at, nodes = as_real(pressure), self.node_pressures
        if nodes.shape[0] == 2:
            return jnp.isfinite(at)
        return (at >= nodes[0]) & (at <= nodes[-1])

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa]; the two directions do not interact."""
        return stresses_between_nodes(self, odd_powers, axial_strain, hoop_strain, pressure)

    def interpolated(self, at: RealArray) -> Float[Array, "... order"]:
        """Coefficients E_n [Pa] at a pressure [Pa] at which they are known, shape (..., order)."""
        nodes, values = self.node_pressures, self.node_coefficients
        cell = jnp.clip(jnp.searchsorted(nodes, at) - 1, 0, nodes.shape[0] - 2)
        share = ((at - nodes[cell]) / (nodes[cell + 1] - nodes[cell]))[..., None]
        return values[cell] + share * (values[cell + 1] - values[cell])


def stresses_between_nodes(
    law: PressurePolynomialMaterial,
    powers: Callable[[Real, int], Float[Array, "... order"]],
    axial_strain: Real,
    hoop_strain: Real,
    pressure: Real,
) -> tuple[RealArray, RealArray]:
    """True stresses [Pa] of coefficients given at pressure nodes, nan where they are not known.

    Args:
        law: the coefficients.
        powers: of the strain up to an order, such as `odd_powers`.
        axial_strain: eps_z [-].
        hoop_strain: eps_c [-].
        pressure: gauge pressure P [Pa].

    Returns:
        (sigma_z, sigma_c) [Pa].
    """
    known = law.known(pressure)
    # Inside the law there is no nan, which would spoil the derivatives of other states.
    coefficients = law.interpolated(jnp.where(known, pressure, law.node_pressures[0]))
    order = coefficients.shape[-1]

    def stress(strain: Real) -> RealArray:
        return jnp.where(known, jnp.sum(powers(strain, order) * coefficients, axis=-1), jnp.nan)

    return stress(axial_strain), stress(hoop_strain)
