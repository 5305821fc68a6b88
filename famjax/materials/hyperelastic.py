"""Stress laws of the bladder from an energy: hyperelastic ones.

Every law here has `energy(axial_stretch, hoop_stretch)`, the energy W [J/m3] stored per volume of
rubber, and its true stresses are sigma_i = lambda_i dW/dlambda_i with lambda = 1 + strain.
"""

import abc
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._types import Given, Real, RealArray, as_real
from ..parameters import Declared, parameter
from ..parameters.parametrised import checked_values
from .abstract_material import AbstractMaterial

STRESS_SCALE = 1e6
"""Order of magnitude [Pa] of a rubber's stress."""


def derivative(function: Callable[[RealArray], RealArray], at: RealArray) -> RealArray:
    """Derivative, element by element, of a function that acts element by element."""
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
        """Energy W [J/m3] per volume at lambda_z, lambda_c [-], both > 0, broadcast shape."""

    @property
    @abc.abstractmethod
    def initial_shear_modulus(self) -> RealArray:
        """Shear modulus mu [Pa] at zero strain; a law of which it is not > 0 is no material."""

    @property
    def initial_modulus(self) -> RealArray:
        """Tangent modulus [Pa] of a tensile test at zero strain, E = 3 mu."""
        return 3 * self.initial_shear_modulus

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True (Cauchy) stresses (sigma_z, sigma_c) [Pa] of the broadcast shape."""
        axial, hoop, _ = jnp.broadcast_arrays(
            1 + as_real(axial_strain), 1 + as_real(hoop_strain), as_real(pressure)
        )
        return (
            axial * derivative(lambda stretch: self.energy(stretch, hoop), axial),
            hoop * derivative(lambda stretch: self.energy(axial, stretch), hoop),
        )

    def uniaxial_stress(self, strain: Real) -> RealArray:
        """True stress [Pa] of a tensile test, sigma = lambda dW/dlambda along lambda^-1/2.

        Args:
            strain: eps [-], engineering, > -1.

        Returns:
            sigma [Pa], of the strain's shape.
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
        """Energy W [J/m3] per volume, broadcast shape."""
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
        """Energy W [J/m3] per volume, broadcast shape."""
        axial, hoop = as_real(axial_stretch), as_real(hoop_stretch)
        I2 = 1 / axial**2 + 1 / hoop**2 + (axial * hoop) ** 2
        return self.c10 * (_first_invariant(axial, hoop) - 3) + self.c01 * (I2 - 3)

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa], 2 (lambda_i^2 - lambda_r^2) (C10 + lambda_j^2 C01)."""
        del pressure
        axial, hoop = (1 + as_real(axial_strain)) ** 2, (1 + as_real(hoop_strain)) ** 2
        radial = 1 / (axial * hoop)
        return (
            2 * (axial - radial) * (self.c10 + hoop * self.c01),
            2 * (hoop - radial) * (self.c10 + axial * self.c01),
        )

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
        """The law of this many terms, by default three."""
        fields.setdefault("coefficients", np.full(order, STRESS_SCALE))
        return super().template(**fields)

    def energy(self, axial_stretch: Real, hoop_stretch: Real) -> RealArray:
        """Energy W [J/m3] per volume, broadcast shape."""
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
    """The Ogden law of any number of terms.

    W = sum over p of mu_p / alpha_p (lambda_z^alpha_p + lambda_c^alpha_p + lambda_r^alpha_p - 3).
    Some programs write 2 mu_p / alpha_p^2 instead: their mu_p is alpha_p / 2 times this one.

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
        """Energy W [J/m3] per volume, broadcast shape."""
        axial, hoop = as_real(axial_stretch)[..., None], as_real(hoop_stretch)[..., None]
        a = self.exponents
        powers = axial**a + hoop**a + (axial * hoop) ** -a
        return jnp.sum(self.moduli / a * (powers - 3), axis=-1)

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses [Pa], sigma_i = sum over p of mu_p (lambda_i^alpha_p - lambda_r^alpha_p)."""
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
        """The law of one term, neo-Hookean."""
        exponent = 2.0
        fields.setdefault("moduli", [2 * STRESS_SCALE / exponent])
        fields.setdefault("exponents", [exponent])
        return super().template(**fields)

    def parameters(self) -> dict[str, RealArray]:
        """Shear modulus G = mu alpha / 2 and exponent of one term; mu_p and alpha_p of several."""
        if self.moduli.shape != (1,):
            return super().parameters()
        return dict(zip(_ONE_TERM, (self.initial_shear_modulus, self.exponents[0]), strict=True))

    def declared(self) -> dict[str, Declared]:
        """The declarations of the same."""
        return super().declared() if self.moduli.shape != (1,) else dict(_ONE_TERM)

    def with_parameters(self, values: Mapping[str, Real]) -> "OgdenMaterial":
        """The law with other values; of one term, mu = 2 G / alpha.

        Exponents nearer to 0 than 1e-6 are moved by that, so that the limit, Hencky's law, is met to
        about 1e-6.

        Raises:
            ValueError: an unknown name, or a value that is an array.
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
