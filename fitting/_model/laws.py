"""The families of bladder laws that can be identified: linear coefficients, and a shape or none.

Stress is linear in the coefficients of every family once its shape parameters are given. So each
fit has a convex core, whatever the law.
"""

import abc

import equinox as eqx
from jaxtyping import Array, Float

import famjax

from .._errors import InputError
from .parameters import Entry

_MAX_ORDER = 8


class AbstractLaw(eqx.Module):
    """A family of laws, as a function of shape parameters and linear coefficients [Pa]."""

    @property
    @abc.abstractmethod
    def coefficients(self) -> dict[str, Entry]:
        """The coefficients [Pa] by name, with the bounds that the law itself asks for."""

    @property
    def shape(self) -> dict[str, Entry]:
        """The parameters in which the stress is not linear, by name."""
        return {}

    @abc.abstractmethod
    def material(
        self, shape: Float[Array, " s"], coefficients: Float[Array, " n"]
    ) -> famjax.AbstractMaterial:
        """The material with these parameters, in the order of `shape` and `coefficients`."""

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return len(self.coefficients)


class PolynomialLaw(AbstractLaw):
    """sigma = sum of E_n sign(eps) |eps|^n up to an order: the reference work's law."""

    degree: int = eqx.field(static=True, default=3)

    def __check_init__(self) -> None:
        if not 1 <= self.degree <= _MAX_ORDER:
            raise InputError(
                f"the order of the law lies between 1 and {_MAX_ORDER}, got {self.degree}"
            )

    @property
    def coefficients(self) -> dict[str, Entry]:
        """E_1 to E_order, of either sign."""
        return {f"E_{n}": Entry(kind="stress") for n in range(1, self.degree + 1)}

    def material(
        self, shape: Float[Array, " s"], coefficients: Float[Array, " n"]
    ) -> famjax.PolynomialMaterial:
        """The polynomial material."""
        del shape
        return famjax.PolynomialMaterial(coefficients)


class OgdenLaw(AbstractLaw):
    """The one-term Ogden law by its shear modulus G = mu alpha / 2 [Pa] and exponent alpha."""

    @property
    def coefficients(self) -> dict[str, Entry]:
        """The shear modulus, which no material has below zero."""
        return {"shear_modulus": Entry(min=0.0, kind="stress")}

    @property
    def shape(self) -> dict[str, Entry]:
        """The exponent; below zero the rubber is stiffer when compressed."""
        return {"ogden_exponent": Entry(min=-15.0, max=-0.5)}

    def material(
        self, shape: Float[Array, " s"], coefficients: Float[Array, " n"]
    ) -> famjax.OgdenMaterial:
        """The Ogden material with mu = 2 G / alpha."""
        return famjax.OgdenMaterial(2 * coefficients / shape, shape)


class MooneyRivlinLaw(AbstractLaw):
    """The Mooney-Rivlin law, linear in C10 and C01."""

    @property
    def coefficients(self) -> dict[str, Entry]:
        """C10 and C01, of either sign."""
        return {"C10": Entry(kind="stress"), "C01": Entry(kind="stress")}

    def material(
        self, shape: Float[Array, " s"], coefficients: Float[Array, " n"]
    ) -> famjax.MooneyRivlinMaterial:
        """The Mooney-Rivlin material."""
        del shape
        return famjax.MooneyRivlinMaterial(coefficients[0], coefficients[1])


class SaturatingLaw(AbstractLaw):
    """E_inf eps + S (1 - exp(-|eps|/s)) sign(eps), linear in E_inf and S."""

    @property
    def coefficients(self) -> dict[str, Entry]:
        """Final modulus and saturation stress, neither below zero."""
        return {
            "final_modulus": Entry(min=0.0, kind="stress"),
            "saturation_stress": Entry(min=0.0, kind="stress"),
        }

    @property
    def shape(self) -> dict[str, Entry]:
        """The strain over which the second term rises."""
        return {"strain_scale": Entry(min=2e-3, max=0.5)}

    def material(
        self, shape: Float[Array, " s"], coefficients: Float[Array, " n"]
    ) -> famjax.SaturatingMaterial:
        """The saturating material."""
        return famjax.SaturatingMaterial(coefficients[0], coefficients[1], shape[0])


class MonotoneLaw(AbstractLaw):
    """A tangent modulus >= 0 at knots, linear between them: stress rises, in any form."""

    knots: tuple[float, ...] = eqx.field(static=True, default=(0.0, 0.03, 0.1, 0.3))

    @property
    def coefficients(self) -> dict[str, Entry]:
        """The tangent modulus at each knot, none below zero."""
        return {f"modulus_at_{knot:g}": Entry(min=0.0, kind="stress") for knot in self.knots}

    def material(
        self, shape: Float[Array, " s"], coefficients: Float[Array, " n"]
    ) -> famjax.MonotoneMaterial:
        """The monotone material."""
        del shape
        return famjax.MonotoneMaterial(self.knots, coefficients)


LAWS: dict[str, type[AbstractLaw]] = {
    "polynomial": PolynomialLaw,
    "ogden": OgdenLaw,
    "mooney-rivlin": MooneyRivlinLaw,
    "saturating": SaturatingLaw,
    "monotone": MonotoneLaw,
}
"""The families by name."""


def law_named(law: str | AbstractLaw, order: int | None) -> AbstractLaw:
    """The law of that name; `order` is for the polynomial alone.

    Raises:
        InputError: an unknown name, or an order for a law that has none.
    """
    if isinstance(law, str) and law not in LAWS:
        raise InputError(f"the law is one of {', '.join(LAWS)}, got {law!r}")
    if law == "polynomial":
        return PolynomialLaw(3 if order is None else order)
    if order is not None:
        raise InputError(
            f"only the polynomial law named as such has an order, got {order} for {law}"
        )
    return LAWS[law]() if isinstance(law, str) else law
