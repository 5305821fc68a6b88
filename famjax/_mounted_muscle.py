"""A muscle between mountings that give way: what a test rig measures."""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from ._muscle import Muscle
from ._types import Real, RealArray, as_real

_FOUND = 1e-4  # of the rigid force: what is left where a bracket held no root at all


class MountedMuscle(eqx.Module):
    """A muscle in series with the compliance of its mountings and of the rig.

    F = F_muscle(x - c F, P), with x the length that the rig measures: under load the mountings
    give way by c F and the muscle is that much shorter.

    Attributes:
        muscle: the muscle itself.
        compliance: c [m/N], >= 0.
    """

    muscle: Muscle
    compliance: Float[Array, "..."] = eqx.field(converter=as_real)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at measured length x [m] and gauge pressure P [Pa], broadcast shape.

        Bisection between no force and that of a rigid mounting, F_muscle(x, P), for a muscle that
        pulls the less the shorter it is. Differentiable to any order in the arguments and in every
        number of the muscle, by the implicit function theorem; nan where there is no such force.
        """
        lengths, pressures = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        return jax.vmap(self._force)(lengths.ravel(), pressures.ravel()).reshape(lengths.shape)

    def _force(self, length: RealArray, pressure: RealArray) -> RealArray:
        rigid = jax.lax.stop_gradient(self.muscle.force(length, pressure))
        scale = jnp.where(rigid == 0, 1.0, rigid)

        def residual(share: RealArray, args: tuple["MountedMuscle", Array, Array]) -> RealArray:
            mounted, length, pressure = args
            shortened = length - mounted.compliance * share * scale
            return share - mounted.muscle.force(shortened, pressure) / scale

        fine = jnp.finfo(scale.dtype)
        tolerance = 4 * float(fine.eps)
        solution = optx.root_find(
            residual,
            optx.Bisection(rtol=tolerance, atol=tolerance, flip=False),
            jnp.full_like(scale, 0.5),
            (self, length, pressure),
            # A little more than all of the rigid force, which a rigid mounting itself has.
            options={"lower": jnp.full_like(scale, -0.1), "upper": jnp.full_like(scale, 1.1)},
            max_steps=fine.nmant + 2,
            throw=False,
        )
        found = jnp.abs(residual(solution.value, (self, length, pressure))) < _FOUND
        return jnp.where(found, solution.value * scale, jnp.nan)
