"""A muscle between mountings that give way: what a test rig measures."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._compiled import compiled
from .._each import at_each
from .._types import Given, Real, RealArray, as_real
from ..parameters import Declared, parameter
from .abstract_muscle import AbstractMuscle
from .equilibrium import bisected

_FOUND = 1e-4  # of the rigid force: what is left where a bracket held no root at all
_ROUNDED = 64  # times the precision
_HIGHEST_COMPLIANCE = 2e-5  # m/N


class MountedMuscle(AbstractMuscle):
    """A muscle in series with the compliance of its mountings and of the rig.

    F = F_muscle(x - c F, P), with x the length that the rig measures: under load the mountings
    give way by c F and the muscle is that much shorter.

    Attributes:
        muscle: the muscle itself.
        compliance: c [m/N], >= 0.
    """

    muscle: AbstractMuscle
    compliance: Float[Given, "..."] = parameter(
        "m/N", name="series_compliance", low=0.0, high=_HIGHEST_COMPLIANCE
    )

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at measured length x [m] and gauge pressure P [Pa], broadcast shape.

        Bisection between no force and that of a rigid mounting, F_muscle(x, P), for a muscle that
        pulls the less the shorter it is. Differentiable to any order in the arguments and in every
        number of the muscle, by the implicit function theorem; nan where there is no such force.
        """
        return _forces(self, as_real(length), as_real(pressure))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """The muscle's own: without load the mountings do not give way."""
        return self.muscle.length_range()

    def stops(self) -> Float[Array, "2"]:
        """The muscle's own."""
        return self.muscle.stops()

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid, at the length that the mountings leave the muscle."""
        own = as_real(length) - self.compliance * self.force(length, pressure)
        return self.muscle.volume(own, pressure)

    def declared(self) -> dict[str, Declared]:
        """The compliance's declaration and the muscle's, none of them linear.

        The force acts on the length at which the muscle is asked, so it is affine in nothing.
        """
        own = super().declared()
        return {name: dataclasses.replace(one, linear=False) for name, one in own.items()}

    @property
    def rest_length(self) -> RealArray:
        """Measured length [m] of zero contraction without load: the muscle's own."""
        return self.muscle.rest_length


@compiled
def _forces(mounted: MountedMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    def one(length: RealArray, pressure: RealArray) -> RealArray:
        rigid = jax.lax.stop_gradient(mounted.muscle.force(length, pressure))
        scale = jnp.where(jnp.isfinite(rigid) & (rigid != 0), rigid, 1.0)

        def residual(share: RealArray) -> RealArray:
            shortened = length - mounted.compliance * share * scale
            return share - mounted.muscle.force(shortened, pressure) / scale

        fine = jnp.finfo(scale.dtype)
        share = bisected(
            residual,
            # A little more than all of the rigid force, which a rigid mounting itself has.
            jnp.full_like(scale, -0.1),
            jnp.full_like(scale, 1.1),
            tolerance=4 * float(fine.eps),
            max_steps=fine.nmant + 2,
        )
        # Near zero force what is left is rounding: less than what a rounded length makes of it.
        nearby = mounted.muscle.force(length * (1 + _ROUNDED * fine.eps), pressure)
        rounding = jnp.nan_to_num(jnp.abs(nearby - rigid) / jnp.abs(scale))
        found = jnp.abs(residual(share)) < _FOUND + rounding
        return jnp.where(found & jnp.isfinite(rigid), share * scale, jnp.nan)

    return at_each(one, length, pressure)
