"""Stress laws of the bladder. Engineering strain in, true stress out."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._types import Real, RealArray, as_real


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


class AbstractMaterial(eqx.Module):
    """A bladder material in the force balance: two strains in, two true stresses out."""

    @abc.abstractmethod
    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa], positive in tension.

        Args:
            axial_strain: eps_z [-], engineering, negative when the muscle is shorter.
            hoop_strain: eps_c [-], engineering, at mid-wall.
            pressure: gauge pressure P [Pa]; ignored by laws that do not depend on it.

        Returns:
            (sigma_z, sigma_c) [Pa], each of the broadcast shape.
        """


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

    coefficients: Float[Array, " order"] = eqx.field(converter=as_real)

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

    node_pressures: Float[Array, " nodes"] = eqx.field(converter=as_real)
    node_coefficients: Float[Array, "nodes order"] = eqx.field(converter=as_real)

    def __check_init__(self) -> None:
        if self.node_pressures.shape[0] < 2:
            raise ValueError(
                "a pressure-dependent law needs at least two node pressures, got "
                f"{self.node_pressures.shape[0]}; use PolynomialMaterial for one"
            )

    def coefficients_at(self, pressure: Real) -> Float[Array, "... order"]:
        """Coefficients E_n [Pa] at gauge pressure P [Pa], shape (..., order)."""
        nodes, values = self.node_pressures, self.node_coefficients
        at = as_real(pressure)
        cell = jnp.clip(jnp.searchsorted(nodes, at) - 1, 0, nodes.shape[0] - 2)
        share = ((at - nodes[cell]) / (nodes[cell + 1] - nodes[cell]))[..., None]
        result = values[cell] + share * (values[cell + 1] - values[cell])
        if nodes.shape[0] == 2:
            return result
        known = (at >= nodes[0]) & (at <= nodes[-1])
        return jnp.where(known[..., None], result, jnp.nan)

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa]; the two directions do not interact."""
        coefficients = self.coefficients_at(pressure)
        order = coefficients.shape[-1]
        axial = jnp.sum(odd_powers(axial_strain, order) * coefficients, axis=-1)
        hoop = jnp.sum(odd_powers(hoop_strain, order) * coefficients, axis=-1)
        return axial, hoop
