"""Compute the work done on the load along an isobar, and the sources of this work."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ._arrays import Real, RealArray, as_real, at_each
from .boundary.errors import InputError
from .compile_options import quick_jit
from .equilibrium import EquilibriumMuscle
from .muscle import AbstractMuscle, Muscle

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


class WorkBudget(eqx.Module):
    """Work [J] done in a stroke at constant pressure; every field has the broadcast shape.

    Attributes:
        load: work done on the load, -int F dL; positive if the muscle shortens and pulls.
        fluid: work done by the fluid on the muscle, int P dV.
        stored: change in the energy stored in bladder and threads.
        bulk: volume [m3] within the outline at the start of the stroke.
    """

    load: RealArray
    fluid: RealArray
    stored: RealArray
    bulk: RealArray

    @property
    def left_over(self) -> RealArray:
        """Work done by the fluid, minus the work on the load and the stored energy.

        The result is negative if the model creates energy.
        """
        return self.fluid - self.stored - self.load

    @property
    def efficiency(self) -> RealArray:
        """Work on the load divided by the work done by the fluid."""
        return self.load / self.fluid

    @property
    def density(self) -> RealArray:
        """Work on the load per unit muscle volume [J/m3]."""
        return self.load / self.bulk


def work_budget(muscle: AbstractMuscle, pressure: Real, start: Real, end: Real) -> WorkBudget:
    """Return the work budget of a stroke at constant pressure.

    In a muscle at equilibrium without losses, all work done by the fluid goes into the load, the
    bladder and the threads. A positive remainder indicates friction or a deadband. A negative
    remainder means that the model creates energy. Gaylord's term, which was derived for a cylinder,
    does so with a measured shape.

    Args:
        muscle: a `Muscle` with a geometry and a bladder law, or an `EquilibriumMuscle`.
        pressure: gauge pressure P [Pa].
        start: active length L [m] at the start of the stroke.
        end: active length L [m] at the end of the stroke, such as `length_at_load(0, pressure)`.

    Returns:
        The budget; nan if the stroke leaves the range of the geometry.

    Raises:
        InputError: the model has no geometry.

    References:
        Chambers 2021, section 6.4.4 (open question).

    >>> import famjax
    >>> braid, tube = famjax.Braid(9.89, 1.09, 0.011), famjax.Bladder(9.28125, 0.875, 0.0625)
    >>> muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, tube),
    ...                        famjax.PolynomialMaterial([257.8, -57.9, 32.7]))  # inches, psi
    >>> budget = work_budget(muscle, 100.0, 9.28125, 6.2)
    >>> print(f"{budget.load:.0f} {budget.fluid:.0f} {budget.stored:.0f} {budget.left_over:.0f}")
    1470 1740 273 -3
    """
    if not isinstance(muscle, Muscle | EquilibriumMuscle):
        raise InputError(
            f"the fluid's work requires a geometry, which {type(muscle).__name__} does not have: pass "
            "a famjax.Muscle or a famjax.EquilibriumMuscle"
        )
    return _work(muscle, *map(as_real, (pressure, start, end)))


@quick_jit
def _work(
    muscle: Muscle | EquilibriumMuscle, pressure: RealArray, start: RealArray, end: RealArray
) -> WorkBudget:
    def one(pressure: RealArray, start: RealArray, end: RealArray) -> WorkBudget:
        lengths = (start + end) / 2 + (end - start) / 2 * _NODES.astype(pressure.dtype)
        weights = (end - start) / 2 * _WEIGHTS.astype(pressure.dtype)
        if isinstance(muscle, EquilibriumMuscle):
            found = muscle.state(jnp.concatenate([lengths, jnp.stack([start, end])]), pressure)
            forces, (first, last) = found.force[:-2], found.volume[-2:]
            stored = found.energy[-1] - found.energy[-2]
            rubber = muscle.bladder.volume
        else:
            first, last = muscle.volume(start, pressure), muscle.volume(end, pressure)
            forces, rates = jax.vmap(functools.partial(_rates, muscle, pressure))(lengths)
            stored = weights @ rates
            rubber = muscle.geometry.dimensions(start, pressure).bladder_volume
        return WorkBudget(-weights @ forces, pressure * (last - first), stored, first + rubber)

    return at_each(one, pressure, start, end)


def _rates(muscle: Muscle, pressure: RealArray, length: RealArray) -> tuple[RealArray, RealArray]:
    """Return the force [N], and the rate dU/dL [N] of the energy stored in bladder and threads."""
    at = muscle.geometry.dimensions_with_rates(length, pressure)
    rate: Any = at.rates
    stresses = muscle.material.stresses(at.axial_strain[None], at.hoop_strain, pressure)
    work = stresses[0] * rate.axial_strain / (1 + at.axial_strain)
    work += stresses[1] * rate.hoop_strain / (1 + at.hoop_strain)
    stored = at.bladder_volume * jnp.sum(at.station_weights * work)
    braid = getattr(muscle.geometry, "braid", None)
    if braid is not None and at.thread_length is not None:
        strain = at.thread_length / braid.rest_thread_length - 1
        stretched = strain != 0  # an inelastic braid divides by the strain
        tension = braid.threads_tension(jnp.where(stretched, strain, 1.0))
        if tension is not None:
            stored += jnp.where(stretched, tension, 0.0) * rate.thread_length
    return muscle.force(length, pressure), stored
