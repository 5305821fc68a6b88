"""Stress laws for the bladder: true stress as a function of engineering strain."""

import abc
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._arrays import Given, Real, RealArray, as_real, promoting
from .parameters import Declared, Parametrised, checked_values, number, parameter

STRESS_SCALE = 1e6
"""Typical magnitude [Pa] of a coefficient, used to scale it in a search."""


class AbstractMaterial(Parametrised):
    """A bladder material: true stresses as functions of two strains.

    Class variables:
        directions_interact: False if each stress depends only on the strain in its own direction. Only
            such a law has a tangent modulus for a single direction.
        depends_on_pressure: True if the stresses depend on the pressure. In that case, stability must be
            checked at every pressure.
        law_name: name of the law on the command line; "" if it has none.
    """

    directions_interact: ClassVar[bool] = True
    depends_on_pressure: ClassVar[bool] = True
    law_name: ClassVar[str] = ""

    @abc.abstractmethod
    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """Return the true stresses (sigma_z, sigma_c) [Pa], positive in tension.

        Args:
            axial_strain: eps_z [-], engineering, negative when the muscle is shortened.
            hoop_strain: eps_c [-], engineering, at mid-wall.
            pressure: gauge pressure P [Pa]; ignored by laws that do not depend on it.

        Returns:
            (sigma_z, sigma_c) [Pa], each with the broadcast shape.
        """


class AbstractUniaxialLaw(AbstractMaterial):
    """A law in which each true stress depends only on the strain in its own direction."""

    directions_interact: ClassVar[bool] = False
    depends_on_pressure: ClassVar[bool] = False

    @abc.abstractmethod
    def stress(self, strain: Real) -> RealArray:
        """Return the true stress sigma [Pa] in one direction at engineering strain eps [-]."""

    @promoting
    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """Return the true stresses (sigma_z, sigma_c) [Pa]."""
        del pressure
        return self.stress(axial_strain), self.stress(hoop_strain)


class SaturatingMaterial(AbstractUniaxialLaw):
    """The saturating law: an odd function that is stiff at first and softens to a constant modulus.

    sigma = E_inf eps + S (1 - exp(-|eps|/s)) sign(eps)

    Attributes:
        final_modulus: E_inf [Pa], tangent modulus at large strain.
        saturation_stress: S [Pa], limit of the second term.
        strain_scale: s [-], > 0, strain over which the second term saturates.

    >>> law = SaturatingMaterial(2e5, 1e5, 0.2)
    >>> print(f"{law.stress(0.0):.0f} {jax.grad(law.stress)(0.0):.0f}")
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

    def stress(self, strain: Real) -> RealArray:
        """Return the true stress sigma [Pa] in one direction at engineering strain eps [-]."""
        eps = as_real(strain)
        sign = jnp.where(eps >= 0, 1.0, -1.0)
        rising = -sign * jnp.expm1(-sign * eps / self.strain_scale)
        return self.final_modulus * eps + self.saturation_stress * rising


def odd_powers(strain: Real, order: int) -> Float[Array, "... order"]:
    """Return the odd powers sign(eps) |eps|^n for n = 1 to `order`, with finite gradients at zero.

    Args:
        strain: eps [-].
        order: highest power, >= 1.

    Returns:
        Array of shape (..., order).

    >>> [round(float(value), 3) for value in odd_powers(-0.2, 3)]
    [-0.2, -0.04, -0.008]
    """
    eps = as_real(strain)
    powers = [eps]
    for _ in range(order - 1):
        powers.append(powers[-1] * jnp.abs(eps))
    return jnp.stack(powers, axis=-1)


class PolynomialMaterial(AbstractUniaxialLaw):
    """The reference work's law: sigma = sum over n of E_n sign(eps) |eps|^n in each direction.

    Attributes:
        coefficients: E_n [Pa], shape (order,).

    References:
        Hocking & Wereley 2012; Chambers 2021, equation 7.1.

    >>> latex = PolynomialMaterial([257.8, -57.9, 32.7])  # psi: Chambers 2021, chapter 6
    >>> print(f"{latex.stress(1.0):.1f} {latex.stress(-1.0):.1f}")
    232.6 -232.6
    """

    coefficients: Float[Given, " order"] = parameter(
        "Pa", kind="stress", scale=STRESS_SCALE, linear=True, name="E_{}"
    )

    law_name: ClassVar[str] = "polynomial"

    def __check_init__(self) -> None:
        """Reject coefficients that are not a one-dimensional array."""
        shape = np.shape(self.coefficients)
        if len(shape) != 1 or not shape[0]:
            raise ValueError(
                f"the coefficients E_1, E_2, ... must be an array of shape (order,), got shape {shape}; "
                "to create many laws, use jax.vmap"
            )

    @classmethod
    def template(cls, *, order: int = 3, **fields: Any) -> "PolynomialMaterial":
        """Create the law with a given order, by default 3."""
        fields.setdefault("coefficients", np.full(order, STRESS_SCALE))
        return super().template(**fields)

    def stress(self, strain: Real) -> RealArray:
        """Return the true stress sigma [Pa] at engineering strain eps [-]; sigma(-eps) = -sigma(eps)."""
        return odd_powers(strain, self.coefficients.shape[-1]) @ self.coefficients


class PressurePolynomialMaterial(AbstractMaterial):
    """The polynomial law with coefficients that depend on pressure, specified at pressure nodes.

    E_n is interpolated linearly between nodes. With two nodes, it is also extrapolated linearly. With more
    nodes, the stresses are nan outside the range of the nodes.

    Attributes:
        node_pressures: increasing pressures [Pa] of the nodes, at least two, shape (nodes,).
        node_coefficients: E_n [Pa] at the nodes, shape (nodes, order).
        odd: True for powers sign(eps) |eps|^n; False for plain powers eps^n.

    References:
        Robinson et al. 2015; Chambers 2021, section 7.1.
    """

    node_pressures: Float[Given, " nodes"] = number("Pa")
    node_coefficients: Float[Given, "nodes order"] = parameter(
        "Pa", kind="stress", scale=STRESS_SCALE, linear=True, name="E_{1}_at_node_{0}"
    )
    odd: bool = eqx.field(static=True, default=True)

    directions_interact: ClassVar[bool] = False

    def __check_init__(self) -> None:
        if self.node_pressures.shape[0] < 2:
            raise ValueError(
                "a pressure-dependent law needs at least two node pressures, got "
                f"{self.node_pressures.shape[0]}; for a single pressure, use PolynomialMaterial"
            )

    @promoting
    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """Return the true stresses (sigma_z, sigma_c) [Pa]; nan at pressures outside the nodes' range."""
        at, nodes, values = as_real(pressure), self.node_pressures, self.node_coefficients
        known = (at >= nodes[0]) & (at <= nodes[-1]) if nodes.size > 2 else jnp.isfinite(at)
        at = jnp.where(known, at, nodes[0])  # nan would spoil the derivatives of other states
        cell = jnp.clip(jnp.searchsorted(nodes, at) - 1, 0, nodes.size - 2)
        share = ((at - nodes[cell]) / (nodes[cell + 1] - nodes[cell]))[..., None]
        coefficients = values[cell] + share * (values[cell + 1] - values[cell])

        def stress(strain: Real) -> RealArray:
            powers = odd_powers(strain, values.shape[-1])
            if not self.odd:
                powers = as_real(strain)[..., None] ** np.arange(1, values.shape[-1] + 1)
            return jnp.where(known, jnp.sum(powers * coefficients, axis=-1), jnp.nan)

        return stress(axial_strain), stress(hoop_strain)


def derivative(function: Callable[[RealArray], RealArray], at: RealArray) -> RealArray:
    """Return the derivative of a function that acts on each element separately."""
    return jax.jvp(function, (at,), (jnp.ones_like(at),))[1]


class AbstractHyperelastic(AbstractMaterial):
    """An incompressible hyperelastic law in plane stress: the wall's radial stress is neglected.

    sigma_z = lambda_z dW/dlambda_z, sigma_c = lambda_c dW/dlambda_c, at the radial stretch
    lambda_r = 1 / (lambda_z lambda_c). The two directions interact.

    References:
        Ogden 1997, Non-linear Elastic Deformations, section 4.3.
    """

    depends_on_pressure: ClassVar[bool] = False

    @abc.abstractmethod
    def energy(self, axial_stretch: Real, hoop_stretch: Real) -> RealArray:
        """Return the energy density W [J/m3] at lambda_z, lambda_c [-] > 0, with the broadcast shape."""

    @property
    @abc.abstractmethod
    def initial_shear_modulus(self) -> RealArray:
        """Shear modulus mu [Pa] at zero strain; it must be > 0."""

    @property
    def initial_modulus(self) -> RealArray:
        """Tangent modulus [Pa] at zero strain in a tensile test, E = 3 mu."""
        return 3 * self.initial_shear_modulus

    @promoting
    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """Return the true (Cauchy) stresses (sigma_z, sigma_c) [Pa], with the broadcast shape."""
        axial, hoop, _ = jnp.broadcast_arrays(
            1 + as_real(axial_strain), 1 + as_real(hoop_strain), as_real(pressure)
        )
        return (
            axial * derivative(lambda stretch: self.energy(stretch, hoop), axial),
            hoop * derivative(lambda stretch: self.energy(axial, stretch), hoop),
        )

    def uniaxial_stress(self, strain: Real) -> RealArray:
        """Return the true stress [Pa] in a tensile test: lambda dW/dlambda at lambda_c = lambda^-1/2.

        Args:
            strain: eps [-], engineering, > -1.

        Returns:
            sigma [Pa], with the strain's shape.
        """
        stretch = 1 + as_real(strain)
        return stretch * derivative(lambda along: self.energy(along, 1 / jnp.sqrt(along)), stretch)


def _first_invariant(axial: RealArray, hoop: RealArray) -> RealArray:
    return axial**2 + hoop**2 + 1 / (axial * hoop) ** 2


class NeoHookeanMaterial(AbstractHyperelastic):
    """The neo-Hookean law, W = mu/2 (I1 - 3).

    Attributes:
        shear_modulus: mu [Pa], > 0.

    References:
        Treloar 1943; Rivlin 1948.

    >>> rubber = NeoHookeanMaterial(1.0)
    >>> print(f"{rubber.uniaxial_stress(1.0):.3f}")  # lambda^2 - 1 / lambda
    3.500
    """

    shear_modulus: Float[Given, "..."] = parameter(
        "Pa", kind="stress", low=0.0, scale=STRESS_SCALE, linear=True
    )

    law_name: ClassVar[str] = "neo-hookean"

    def energy(self, axial_stretch: Real, hoop_stretch: Real) -> RealArray:
        """Return the energy density W [J/m3], with the broadcast shape."""
        I1 = _first_invariant(as_real(axial_stretch), as_real(hoop_stretch))
        return self.shear_modulus / 2 * (I1 - 3)

    @property
    def initial_shear_modulus(self) -> RealArray:
        """Shear modulus mu [Pa] at zero strain."""
        return self.shear_modulus


class MooneyRivlinMaterial(AbstractHyperelastic):
    """The Mooney-Rivlin law, W = C10 (I1 - 3) + C01 (I2 - 3).

    Attributes:
        c10: C10 [Pa].
        c01: C01 [Pa]; C10 + C01 > 0.

    References:
        Mooney 1940; Rivlin 1948.
    """

    c10: Float[Given, "..."] = parameter(
        "Pa", kind="stress", scale=STRESS_SCALE, linear=True, name="C10"
    )
    c01: Float[Given, "..."] = parameter(
        "Pa", kind="stress", scale=STRESS_SCALE, linear=True, name="C01"
    )

    law_name: ClassVar[str] = "mooney-rivlin"

    def energy(self, axial_stretch: Real, hoop_stretch: Real) -> RealArray:
        """Return the energy density W [J/m3], with the broadcast shape."""
        axial, hoop = as_real(axial_stretch), as_real(hoop_stretch)
        I2 = 1 / axial**2 + 1 / hoop**2 + (axial * hoop) ** 2
        return self.c10 * (_first_invariant(axial, hoop) - 3) + self.c01 * (I2 - 3)

    @property
    def initial_shear_modulus(self) -> RealArray:
        """Shear modulus [Pa] at zero strain, 2 (C10 + C01)."""
        return 2 * (self.c10 + self.c01)


class YeohMaterial(AbstractHyperelastic):
    """The Yeoh law, W = sum over i of C_i (I1 - 3)^i.

    Attributes:
        coefficients: C_i [Pa], shape (terms,), usually three; C_1 > 0.

    References:
        Yeoh 1993, Rubber Chemistry and Technology 66.
    """

    coefficients: Float[Given, " terms"] = parameter(
        "Pa", kind="stress", scale=STRESS_SCALE, linear=True, name="C_{}"
    )

    law_name: ClassVar[str] = "yeoh"

    @classmethod
    def template(cls, *, order: int = 3, **fields: Any) -> "YeohMaterial":
        """Create the law with a given number of terms, by default 3."""
        fields.setdefault("coefficients", np.full(order, STRESS_SCALE))
        return super().template(**fields)

    def energy(self, axial_stretch: Real, hoop_stretch: Real) -> RealArray:
        """Return the energy density W [J/m3], with the broadcast shape."""
        x = _first_invariant(as_real(axial_stretch), as_real(hoop_stretch)) - 3
        energy = jnp.zeros_like(x)
        for i in reversed(range(self.coefficients.shape[-1])):
            energy = x * (self.coefficients[i] + energy)
        return energy

    @property
    def initial_shear_modulus(self) -> RealArray:
        """Shear modulus [Pa] at zero strain, 2 C_1."""
        return 2 * self.coefficients[0]


class OgdenMaterial(AbstractHyperelastic):
    """The Ogden law, with one or more terms.

    W = sum over p of mu_p / alpha_p (lambda_z^alpha_p + lambda_c^alpha_p + lambda_r^alpha_p - 3).
    Some programs use the factor 2 mu_p / alpha_p^2; their mu_p is alpha_p / 2 times the mu_p used here.

    Attributes:
        moduli: mu_p [Pa], shape (terms,).
        exponents: alpha_p [-], shape (terms,), not zero; sum of mu_p alpha_p > 0.

    References:
        Ogden 1972, Proceedings of the Royal Society A 326.

    >>> treloar = OgdenMaterial([0.63e6, 1.2e3, -1e4], [1.3, 5.0, -2.0])  # Ogden 1972
    >>> print(f"{treloar.initial_shear_modulus / 1e6:.4f}")
    0.4225
    """

    moduli: Float[Given, " terms"] = parameter(
        "Pa", kind="stress", scale=STRESS_SCALE, linear=True, name="mu_{}"
    )
    exponents: Float[Given, " terms"] = parameter(name="alpha_{}")

    law_name: ClassVar[str] = "ogden"

    def __check_init__(self) -> None:
        if self.moduli.shape != self.exponents.shape or self.moduli.ndim == 0:
            raise ValueError(
                "an Ogden law needs one exponent for each modulus, got moduli of shape "
                f"{self.moduli.shape} and exponents of shape {self.exponents.shape}"
            )

    def energy(self, axial_stretch: Real, hoop_stretch: Real) -> RealArray:
        """Return the energy density W [J/m3], with the broadcast shape."""
        axial, hoop = as_real(axial_stretch)[..., None], as_real(hoop_stretch)[..., None]
        a = self.exponents
        powers = axial**a + hoop**a + (axial * hoop) ** -a
        return jnp.sum(self.moduli / a * (powers - 3), axis=-1)

    @promoting
    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """Return the true stresses [Pa], sigma_i = sum_p mu_p (lambda_i^alpha_p - lambda_r^alpha_p)."""
        del pressure
        axial = (1 + as_real(axial_strain))[..., None] ** self.exponents
        hoop = (1 + as_real(hoop_strain))[..., None] ** self.exponents
        radial = 1 / (axial * hoop)
        return (
            jnp.sum(self.moduli * (axial - radial), axis=-1),
            jnp.sum(self.moduli * (hoop - radial), axis=-1),
        )

    @property
    def initial_shear_modulus(self) -> RealArray:
        """Shear modulus [Pa] at zero strain, half the sum of mu_p alpha_p."""
        return jnp.sum(self.moduli * self.exponents, axis=-1) / 2

    @classmethod
    def template(cls, **fields: Any) -> "OgdenMaterial":
        """Create the law with one term; with the default exponent, it is neo-Hookean."""
        exponent = 2.0
        fields.setdefault("moduli", [2 * STRESS_SCALE / exponent])
        fields.setdefault("exponents", [exponent])
        return super().template(**fields)

    def parameters(self) -> dict[str, RealArray]:
        """Return every mu_p and alpha_p; for one term, the shear modulus mu alpha / 2 and the exponent."""
        if self.moduli.shape != (1,):
            return super().parameters()
        return dict(zip(_ONE_TERM, (self.initial_shear_modulus, self.exponents[0]), strict=True))

    def declared(self) -> dict[str, Declared]:
        """Return the declarations of the parameters."""
        return super().declared() if self.moduli.shape != (1,) else dict(_ONE_TERM)

    def with_parameters(self, values: Mapping[str, Real]) -> "OgdenMaterial":
        """Return the law with new values; for one term, mu = 2 G / alpha.

        An exponent within 1e-6 of 0 is increased by 1e-6. The limit for an exponent of 0, Hencky's law, is
        therefore approximated to about 1e-6.

        Raises:
            ValueError: a name is unknown, or a value is an array.
        """
        if self.moduli.shape != (1,):
            return super().with_parameters(values)
        given = self.parameters() | checked_values(self, values)
        modulus, exponent = (given[name] for name in _ONE_TERM)
        if not values:
            return self
        exponent = exponent + jnp.where(jnp.abs(exponent) < _NEARLY_HENCKY, _NEARLY_HENCKY, 0.0)
        return eqx.tree_at(
            lambda law: (law.moduli, law.exponents),
            self,
            ((2 * modulus / exponent)[None], exponent[None]),
        )


_NEARLY_HENCKY = 1e-6
_ONE_TERM = {
    "shear_modulus": Declared(
        "Pa", "shear_modulus", "stress", low=0.0, scale=STRESS_SCALE, linear=True
    ),
    "ogden_exponent": Declared("", "ogden_exponent", low=-15.0, high=15.0),
}
