"""The monotone law: a tangent modulus given at knots, so that stability is a sign."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._types import Given, Real, RealArray, as_real
from ..parameters import parameter
from .uniaxial import AbstractUniaxialLaw

_STRESS = 1e6  # Pa


class MonotoneMaterial(AbstractUniaxialLaw):
    """A law whose tangent modulus is linear between knots and constant beyond the last; odd.

    With all nodal moduli >= 0 the stress rises everywhere: Drucker-stable in every state.

    Attributes:
        knots: strain magnitudes [-] of the nodes, increasing, the first 0.
        moduli: tangent moduli [Pa] at the knots, shape (knots,).

    >>> law = MonotoneMaterial((0.0, 0.1), [4.0, 2.0])
    >>> print(f"{law.stress(0.1):.2f} {law.stress(-0.2):.2f} {law.tangent_modulus(0.05):.1f}")
    0.30 -0.50 3.0
    """

    knots: tuple[float, ...] = eqx.field(static=True)
    moduli: Float[Given, " knots"] = parameter(
        "Pa", kind="stress", low=0.0, scale=_STRESS, linear=True, name="modulus_at_{}"
    )

    law_name: ClassVar[str] = "monotone"

    @classmethod
    def template(
        cls, *, knots: tuple[float, ...] = (0.0, 0.03, 0.1, 0.3), **fields: Any
    ) -> "MonotoneMaterial":
        """The law with these knots and the same modulus at each of them."""
        fields.setdefault("moduli", np.full(len(knots), _STRESS))
        return super().template(knots=knots, **fields)

    def parameter_name(self, field: str, index: tuple[int, ...]) -> str:
        """The name of a modulus, which says its knot: modulus_at_0.03."""
        if field != "moduli":
            return super().parameter_name(field, index)
        return f"modulus_at_{self.knots[index[0]]:g}"

    def __check_init__(self) -> None:
        if len(self.knots) < 2 or self.knots[0] != 0 or not np.all(np.diff(self.knots) > 0):
            raise ValueError(
                "the knots of a monotone law are two or more increasing strains, the first of "
                f"them 0, got {self.knots}"
            )
        if self.moduli.shape != (len(self.knots),):
            raise ValueError(
                f"a monotone law with {len(self.knots)} knots needs as many moduli, got shape "
                f"{self.moduli.shape}"
            )

    def potential(self, strain: Real) -> RealArray:
        """Potential phi [Pa], the modulus integrated twice: a cubic in each cell."""
        strain = as_real(strain)
        knots = np.asarray(self.knots)
        width = np.diff(knots)
        rise = jnp.diff(self.moduli) / width
        size = jnp.where(strain >= 0, strain, -strain)[..., None]
        # Each cell adds what its own change of modulus, and its end, contribute beyond it.
        inside = jnp.clip(size - knots[:-1], 0, width)
        beyond = jnp.maximum(size - knots[1:], 0)
        kinks = rise * (inside**3 / 6 + inside**2 / 2 * beyond + inside * beyond**2 / 2)
        return self.moduli[0] * size[..., 0] ** 2 / 2 + jnp.sum(kinks, axis=-1)
