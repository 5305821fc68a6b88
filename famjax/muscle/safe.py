"""A muscle that a simulator may take anywhere: it cannot push, and it makes no energy."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._compiled import compiled
from .._types import Real, RealArray, as_real
from ..terms import CentredSlip, SlipState
from .abstract_muscle import AbstractMuscle
from .bend import taut, untaut
from .continued import ContinuedMuscle
from .region import Region, Slopes, grid_slopes, rising_region
from .volume import continued_volume

_SLACK = 1e-3  # width of the blend into slack, of the largest force of the region


class SafeMuscle(AbstractMuscle):
    """A muscle inside the region it was identified in, and a passive continuation of it outside.

    F = taut(G), G the model in the region and monotone lines and stops beyond (`ContinuedMuscle`),
    taut(G) = 0 for G <= 0 and G from a small force w up (`taut`). At any length and pressure, also
    at twice those of the data or at none, F is finite, >= 0, C1, and rises with the length: at
    constant pressure the muscle is a spring, from which no simulator can gain energy. Below the
    length at which its braid locks it pulls no longer, whatever the pressure; beyond the length at
    which the threads are straight a stiff stop holds it.

    With hysteresis the pull also depends on the history, which the caller keeps as a state: `start`
    makes it, `pull` asks for the force at the end of a step, `moved` ends the step. Both branches
    of any loop rise with the length and the lengthening one is the higher, and cutting them at zero
    leaves that so: every closed loop takes energy up. All of this without state is the static map.

    Attributes:
        continued: G, not cut at zero; `model_force` asks it.
        slack_width: w [N].
        data: the region of the data. `region` is the part of it in which the model is monotone.
        hysteresis: about the static map, or None.

    >>> import famjax
    >>> braid = famjax.Braid.from_rest(diameter=0.022, braid_angle=1.1, length=0.3)
    >>> shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.3, 0.02, 0.0018, embedded=True))
    >>> muscle = famjax.Muscle(shape, famjax.PolynomialMaterial([6e5, 2e5, 1e5]), 4e4)
    >>> safe = SafeMuscle.of(muscle, length=[0.24, 0.3], pressure=[5e4, 6e5])
    >>> print(f"{safe.force(0.1, 4e5):.0f} {abs(safe.force(0.28, 4e5) - muscle.force(0.28, 4e5)):.2f}")
    0 0.00
    """

    continued: ContinuedMuscle
    slack_width: Float[Array, ""]
    data: Region
    hysteresis: CentredSlip | None = None

    @classmethod
    def of(
        cls,
        muscle: AbstractMuscle,
        length: Sequence[float] | np.ndarray,
        pressure: Sequence[float] | np.ndarray,
        *,
        hysteresis: CentredSlip | None = None,
    ) -> "SafeMuscle":
        """The safe muscle of a model.

        Args:
            muscle: the model.
            length: active lengths [m] at which it was identified, or the least and the greatest.
            pressure: gauge pressures [Pa], likewise.
            hysteresis: about the model's force.

        Raises:
            InputError: no region, or the model is monotone nowhere in it; see `rising_region`.
        """
        data = Region.of(length, pressure)
        region, at = rising_region(muscle, data)
        return cls.within(muscle, region, at, data, hysteresis)

    @classmethod
    def within(
        cls,
        muscle: AbstractMuscle,
        region: Region,
        at: Slopes | None = None,
        data: Region | None = None,
        hysteresis: CentredSlip | None = None,
    ) -> "SafeMuscle":
        """The safe muscle of a model that is known to rise in a region; can be traced.

        Args:
            muscle: the model.
            region: in which it rises.
            at: its force and slopes on a grid over the region; computed unless given.
            data: the region of the data, if it is another one.
            hysteresis: about the model's force.
        """
        at = grid_slopes(muscle, region) if at is None else at
        continued = ContinuedMuscle.of(muscle, region, _stops(muscle), at)
        width = as_real(_SLACK * abs(at.force).max())
        return cls(continued, width, region if data is None else data, hysteresis)

    @property
    def region(self) -> Region:
        """Where the pull is the model's own."""
        return self.continued.region

    @property
    def notes(self) -> tuple[str, ...]:
        """What of the data's region is not the model's own, in sentences; for one muscle."""
        found = []
        for name, unit, scale in (("length", "mm", 1e3), ("pressure", "kPa", 1e-3)):
            had, kept = (
                scale * np.asarray(getattr(one, name), float) for one in (self.data, self.region)
            )
            if (had != kept).any():
                found.append(
                    f"the model is monotone from {kept[0]:.4g} to {kept[1]:.4g} {unit} of {name}, "
                    f"and continued from there, not from the data's {had[0]:.4g} and {had[1]:.4g}"
                )
        return tuple(found)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at any length [m] and gauge pressure [Pa], broadcast shape; >= 0."""
        return taut(self.continued.force(length, pressure), self.slack_width)

    def model_force(self, length: Real, pressure: Real) -> RealArray:
        """G [N], the continued model not cut at zero, broadcast shape; below zero where slack."""
        return self.continued.force(length, pressure)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m] between which an equilibrium is looked for."""
        return self.continued.length_range()

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""
        return self.continued.rest_length

    def length_at_load(self, load: Real, pressure: Real, *, throw: bool = True) -> RealArray:
        """Longest active length L [m] at which the muscle carries a load >= 0 [N].

        That of the continued muscle, which has one where this one is slack at a range of lengths;
        see `AbstractMuscle.length_at_load`.
        """
        return self.continued.length_at_load(
            untaut(as_real(load), self.slack_width), pressure, throw=throw
        )

    def onset_pressure(self, length: Real, highest: Real, *, throw: bool = True) -> RealArray:
        """Gauge pressure [Pa] at which the force leaves zero; see `AbstractMuscle`."""
        return self.continued.onset_pressure(length, highest, throw=throw)

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid, `famjax.muscle.continued_volume`, broadcast shape.

        Raises:
            InputError: the muscle is of a model without a geometry.
        """
        return continued_volume(self.continued.muscle, self.region, length, pressure)

    def start(self, length: Real, pressure: Real) -> SlipState:
        """The state [of hysteresis] with which a history begins at a length and a pressure.

        Reached from where the cycles of the identified records begin: from the vented muscle of
        that length, or after strokes from its longest one. Empty without hysteresis.
        """
        if self.hysteresis is None:
            return SlipState(jnp.zeros(2), jnp.zeros(0), jnp.zeros(0))
        return self.hysteresis.start(as_real(length), as_real(pressure))

    def moved(self, state: SlipState, length: Real, pressure: Real) -> SlipState:
        """The state after a motion to a length [m] and pressure [Pa] that does not turn round."""
        if self.hysteresis is None:
            return state
        return self.hysteresis.slip.moved(state, length, pressure)

    def pull(self, state: SlipState, length: Real, pressure: Real) -> RealArray:
        """Pull [N] at a length [m] and pressure [Pa] to which one step leads from a state; scalars.

        The state itself is not changed, so that an integrator can try several ends of a step;
        `moved` ends the step.
        """
        force = self.continued.force(length, pressure)
        if self.hysteresis is not None:
            force += self.hysteresis.added(self.moved(state, length, pressure), length, pressure)
        return taut(force, self.slack_width)


@compiled
def _stops(muscle: AbstractMuscle) -> Float[Array, "2"]:
    return muscle.stops()
