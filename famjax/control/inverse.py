"""The pressure at which a muscle of a given length pulls with a given force."""

import functools
from typing import Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Int

from .._arrays import Real, RealArray, as_real, at_each, compiled
from .crossing import first_crossing
from .outcome import Answer, Outcome

_CELLS = 16


@runtime_checkable
class HasForce(Protocol):
    """Whatever pulls: a `Muscle`, a model of other authors, a muscle read from a file."""

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa]."""
        ...


class InversePressure(Answer):
    """A pressure for a force, of the broadcast shape of what was asked.

    Attributes:
        pressure: P [Pa], within the limits. Where the force is not attained, that of the nearest
            pull; nan where the muscle has no state.
        force: pull [N] at that pressure.
        code: an `Outcome`: FEASIBLE, FORCE_LOW, FORCE_HIGH or NO_STATE.
    """

    pressure: RealArray
    force: RealArray
    code: Int[Array, "..."]

    @property
    def feasible(self) -> Array:
        """Whether the force is attained, of the same shape."""
        return self.code == Outcome.FEASIBLE


def pressure_for_force(
    muscle: HasForce, force: Real, length: Real, pressures: tuple[Real, Real]
) -> InversePressure:
    """The lowest pressure at which a muscle of a length pulls with a force.

    F(L, P) = F: bracketed in 16 cells between the limits and bisected to the last digit, so that
    it is found where dF/dP > 0 throughout and also where the force turns round. A muscle only pulls:
    a negative force is FORCE_LOW, and the answer the pressure of the least pull; force zero is
    answered by the pressure of the onset.

    Args:
        muscle: with `force(length, pressure)`.
        force: F [N].
        length: active length L [m].
        pressures: lowest and highest gauge pressure [Pa], lowest < highest.

    Returns:
        The pressure with its code, of the broadcast shape of force and length. Differentiable in
        force, length and every number of the muscle by the implicit function theorem, to any order;
        where the force is not attained, the limits do not depend on them.

    >>> import famjax, numpy as np
    >>> braid = famjax.Braid.from_rest(diameter=0.023, braid_angle=1.1, length=0.296)
    >>> shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.296, 0.023, 1.8e-3, embedded=True))
    >>> muscle = famjax.Muscle(shape, famjax.materials.NeoHookeanMaterial(3e5), 40e3)
    >>> found = pressure_for_force(muscle, np.array([500.0, 5000.0]), 0.28, (0.0, 6e5))
    >>> [f"{kPa:.1f}" for kPa in found.pressure / 1e3], [Outcome(int(c)).name for c in found.code]
    (['284.0', '600.0'], ['FEASIBLE', 'FORCE_HIGH'])
    """
    low, high = (as_real(one) for one in pressures)
    return _inverse(muscle, as_real(force), as_real(length), low, high)


@compiled
def _inverse(
    muscle: HasForce, force: RealArray, length: RealArray, low: RealArray, high: RealArray
) -> InversePressure:
    return at_each(functools.partial(inverse_pressure, muscle), force, length, low, high)


def inverse_pressure(
    muscle: HasForce, force: RealArray, length: RealArray, low: RealArray, high: RealArray
) -> InversePressure:
    """The same of one force at one length: see `pressure_for_force`. All of shape ()."""

    def pull(pressure: RealArray) -> RealArray:
        return muscle.force(length, pressure)

    stations = jnp.linspace(low, high, _CELLS + 1)
    # What is below zero is no pull; nearest to it is none at all.
    wanted = jnp.where(force < 0, jnp.zeros_like(force), force)
    crossing = first_crossing(pull, stations, wanted)
    known = jnp.isfinite(crossing.highest) & jnp.isfinite(force)
    below = (force < 0) | (force < crossing.lowest)
    code = jnp.where(
        crossing.found & (force >= 0),
        Outcome.FEASIBLE,
        jnp.where(below, Outcome.FORCE_LOW, Outcome.FORCE_HIGH),
    )
    return InversePressure(
        jnp.where(known, crossing.at, jnp.nan),
        jnp.where(known, pull(crossing.at), jnp.nan),
        jnp.where(known, code, Outcome.NO_STATE).astype(int),
    )
