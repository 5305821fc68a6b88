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
_HIGHEST_COMPLIANCE = 5e-5  # m/N

SEATING_FORCE = 100.0
"""Force [N] at which a rig gives way by the same, whatever its exponent."""
_LINEAR = 1e-3  # of it: below, every rig gives way in proportion to the force


def give_way(force: Real, compliance: Real, exponent: Real | None = None) -> RealArray:
    """How far [m] mountings and rig give way under a force [N], broadcast shape.

    delta = c F s^(n - 1) with s^2 = (F/100 N)^2 + 0.001^2: in proportion to the force for n = 1, and
    else c 100 N (F/100 N)^n, as contacts that grow under load do (Hertz 1882: 2/3 between spheres, 1/2
    between a cone and a plane). Below a tenth of a newton it is in proportion to the force for every
    n, as it must be for the stiffness to stay finite; odd in the force, smooth everywhere.

    Args:
        force: [N].
        compliance: c [m/N], that of the secant at 100 N, >= 0.
        exponent: n > 0; None stands for 1.
    """
    force, compliance = as_real(force), as_real(compliance)
    if exponent is None:
        return compliance * force
    squared = (force / SEATING_FORCE) ** 2 + _LINEAR**2
    return compliance * force * squared ** ((as_real(exponent) - 1) / 2)


class MountedMuscle(AbstractMuscle):
    """A muscle in series with the compliance of its mountings and of the rig.

    F = F_muscle(x - delta(F), P), with x the length that the rig measures: under load the mountings
    give way by delta = c F, or by a power of the force, see `give_way`, and the muscle is that much
    shorter.

    Attributes:
        muscle: the muscle itself.
        compliance: c [m/N], >= 0; where there is an exponent, that of the secant at 100 N.
        exponent: n of the power, in (0, 1]; None for a rig that gives way in proportion.
    """

    muscle: AbstractMuscle
    compliance: Float[Given, "..."] = parameter(
        "m/N", name="series_compliance", low=0.0, high=_HIGHEST_COMPLIANCE
    )
    exponent: Float[Given, "..."] | None = parameter(
        name="series_exponent", low=0.3, high=1.0, default=None
    )

    def gives_way(self, force: Real) -> RealArray:
        """How far [m] the mountings give way under a force [N], broadcast shape."""
        return give_way(force, self.compliance, self.exponent)

    def with_muscle(self, muscle: AbstractMuscle) -> "MountedMuscle":
        """Another muscle in the same rig."""
        return MountedMuscle(muscle, self.compliance, self.exponent)

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
        force = self.force(length, pressure)
        known = jnp.isfinite(force)
        own = as_real(length) - self.gives_way(jnp.where(known, force, 0.0))
        return jnp.where(known, self.muscle.volume(own, pressure), jnp.nan)

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
            shortened = length - mounted.gives_way(share * scale)
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
