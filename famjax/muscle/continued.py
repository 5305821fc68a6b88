"""A force model beyond the states it was identified at: monotone, finite and smooth everywhere."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._compiled import compiled
from .._types import Given, Real, RealArray, as_number, as_real
from .abstract_muscle import AbstractMuscle
from .bend import bent, stopped
from .region import AnyArray, Region, Slopes

_STOP = 0.01  # of the rest length: there a stop takes the largest force of the region
_ONSET = _STOP / 2
_AT_ONCE = 1e12  # 1/m and 1/Pa: no step at all
_SPARE = 1.05  # ends are this much nearer than grid lines say, for what lies between them


class ContinuedMuscle(AbstractMuscle):
    """A model inside a region, and straight lines that continue it outside, not cut at zero force.

        H(L, P) = F(L_c, P) + F_L(L_c, P) y(L - L_c)                  L_c: L held in the region
        G(L, P) = H(L, P_c) + H_P(L, P_c) y(P - P_c) + S(L)           P_c: P held in the region

    Inside it is the model itself, to the last bit. Across every edge it is C1, as F is C2. y is a
    straight line (`bent`) unless slopes of the model at the edge would then turn the pull round:
    where the stiffness falls along the pressure, or the area F_P along the length, y ends at the
    step that leaves both >= 0. S are two stops, outside of the region: one from where the threads
    are straight, one below where the braid locks, which pushes; each takes the largest force of
    the region on a hundredth of the rest length.

    So dG/dL >= 0 at every pressure and dG/dP >= 0 at every length outside, whatever the model, if
    it is `rising` on the region's edges: F_L >= 0 is held by cutting it at zero there.

    Attributes:
        muscle: the model.
        region: where it is taken as it is.
        stops: lengths [m] at which the stops begin, shape (2,).
        stop_stiffness: [N/m].
        length_ends: 1/X [1/m] of the steps below and above the region's lengths, shape (2,).
        pressure_ends: 1/X [1/Pa] of those below and above its pressures, shape (2,).
    """

    muscle: AbstractMuscle
    region: Region
    stops: Float[Given, "2"] = eqx.field(converter=as_number)
    stop_stiffness: Float[Given, ""] = eqx.field(converter=as_number)
    length_ends: Float[Given, "2"] = eqx.field(converter=as_number)
    pressure_ends: Float[Given, "2"] = eqx.field(converter=as_number)

    @classmethod
    def of(cls, muscle: AbstractMuscle, region: Region, stops: AnyArray, at: Slopes):
        """The continuation of a model. Pure: it can be traced and mapped over muscles.

        Args:
            muscle: the model.
            region: in which it rises, see `rising_region`.
            stops: where the braid locks and where its threads are straight [m], shape (2,); what
                lies within the region is moved to its edge, and so is nan.
            at: force and slopes on a grid over the region.
        """
        ends = jnp.fmin(stops[0], region.length[0]), jnp.fmax(stops[1], region.length[1])
        stiffness = abs(at.force).max() / (_STOP * muscle.rest_length)
        return cls(muscle, region, jnp.stack(ends), stiffness, *_ends(at))

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Continued pull G [N] at any length [m] and pressure [Pa], broadcast shape; may be < 0."""
        return _force(self, *jnp.broadcast_arrays(as_real(length), as_real(pressure)))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """The stops [m], with what a stop gives under four times the largest force."""
        travel = 4 * _STOP * self.muscle.rest_length
        return self.stops[0] - travel, self.stops[1] + travel

    @property
    def stop_onset(self) -> RealArray:
        """Travel [m] on which a stop's stiffness builds up."""
        return _ONSET * self.muscle.rest_length

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""
        return self.muscle.rest_length


def _ends(at: Slopes) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """The nearest ends, as 1/X, that keep area and stiffness >= 0 beyond lengths and pressures."""
    xp = at.force.__array_namespace__()

    def end(falling: AnyArray, held: AnyArray) -> AnyArray:
        falls, holds = falling > 0, held > 0
        rate = xp.where(falls & holds, falling, 0.0) / xp.where(holds, held, 1.0)
        rate = xp.where(falls & ~holds, _AT_ONCE, rate)
        return xp.asarray(xp.minimum(_SPARE * rate.max(), _AT_ONCE))

    K, A, mixed = at.stiffness, at.area, at.stiffening
    lengths = xp.stack([end(mixed[0], A[0]), end(-mixed[-1], A[-1])])
    pressures = xp.stack([end(mixed[:, 0], K[:, 0]), end(-mixed[:, -1], K[:, -1])])
    return jnp.asarray(lengths), jnp.asarray(pressures)


@compiled
def _force(of: ContinuedMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    L = jnp.clip(length, of.region.length[0], of.region.length[1])
    P = jnp.clip(pressure, of.region.pressure[0], of.region.pressure[1])
    step = bent(length - L, of.length_ends)

    def along(pressure: RealArray) -> RealArray:
        force, stiffness = jax.jvp(
            lambda length: of.muscle.force(length, pressure), (L,), (jnp.ones_like(L),)
        )
        return force + jnp.maximum(stiffness, 0.0) * step

    force, area = jax.jvp(along, (P,), (jnp.ones_like(P),))
    force += jnp.maximum(area, 0.0) * bent(pressure - P, of.pressure_ends)
    stop = of.stop_stiffness, of.stop_onset
    return force + stopped(length - of.stops[1], *stop) - stopped(of.stops[0] - length, *stop)
