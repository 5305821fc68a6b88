"""The Maxwell-slip element, a spring in series with a dry slider, and what moves it in a muscle."""

from typing import TYPE_CHECKING, Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._types import Given, Real, RealArray, as_number

if TYPE_CHECKING:
    Either: TypeAlias = Any  # NumPy's or JAX's, as the arguments are
else:
    Either: TypeAlias = Real


def slip(deflection: Either, change: Either, threshold: Either) -> Either:
    """Deflection of an element after its coordinate has moved one way by `change`.

        s <- min(max(s + dq, -delta), delta)

    Exact for a motion of any size that does not turn round. Takes NumPy's arrays or JAX's.

    Args:
        deflection: s before.
        change: dq, of the same unit.
        threshold: delta > 0 at which the slider gives way.

    Returns:
        s afterwards, broadcast shape.

    References:
        Rizos & Fassois 2004, Chaos 14(2), 431-445: the element and its identification.

    >>> float(slip(0.5, 2.0, 1.0)), float(slip(1.0, -1.5, 1.0))
    (1.0, -0.5)
    """
    moved = deflection + change
    xp = jnp if isinstance(moved, jax.Array) else np
    return xp.minimum(xp.maximum(moved, -threshold), threshold)


def slip_shares(pressure: Either, modulus: Either) -> tuple[Either, Either]:
    """Rates of the coordinates of wall and braid in the strain, 1 + P/E and P/E [-].

    Takes NumPy's arrays or JAX's; see `MaxwellSlip`.

    Args:
        pressure: gauge pressure P [Pa].
        modulus: E [Pa].
    """
    ratio = pressure / modulus
    return 1 + ratio, ratio


def slip_coordinates(
    length: Either, pressure: Either, rest_length: Either, modulus: Either
) -> tuple[Either, Either]:
    """Coordinates of wall and braid [-], -eps (1 + P/E) and -eps P/E, broadcast shape.

    Takes NumPy's arrays or JAX's; see `MaxwellSlip`.

    Args:
        length: L [m].
        pressure: gauge pressure P [Pa].
        rest_length: L0 [m].
        modulus: E [Pa].
    """
    strain = length / rest_length - 1
    wall, braid = slip_shares(pressure, modulus)
    return strain * wall, strain * braid


class SlipElements(eqx.Module):
    """Elements side by side on one coordinate.

    Attributes:
        threshold: delta of each element, in the unit of the coordinate, > 0, shape (k,).
        strength: force [N] of each element while it slides, >= 0, shape (k,).
    """

    threshold: Float[Given, " k"] = eqx.field(converter=as_number)
    strength: Float[Given, " k"] = eqx.field(converter=as_number)

    @classmethod
    def none(cls) -> "SlipElements":
        """No elements."""
        return cls(jnp.zeros(0), jnp.zeros(0))

    def force(self, deflection: Float[Array, "*n k"]) -> RealArray:
        """Sum [N] of strength times s / delta, shape (*n,)."""
        return jnp.sum(self.strength * deflection / self.threshold, axis=-1)

    def energy(self, deflection: Float[Array, "*n k"]) -> RealArray:
        """Energy stored in the springs, force times the unit of the coordinate, shape (*n,)."""
        return jnp.sum(self.strength * deflection**2 / (2 * self.threshold), axis=-1)

    def heat(self, deflection: Float[Array, "n k"], change: Float[Array, " m"]) -> RealArray:
        """Sum of strength times path slid, of deflections in order and the motions between them."""
        slid = jnp.abs(change[:, None] - jnp.diff(deflection, axis=0))
        return jnp.sum(self.strength * slid)
