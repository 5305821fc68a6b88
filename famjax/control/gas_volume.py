"""The volume of gas in a muscle: at any state, at a held length, under a held load."""

from typing import Any

import equinox as eqx
from jaxtyping import Float

from .._arrays import Given, Real, RealArray, as_number
from ..boundary.errors import InputError
from ..muscle import AbstractMuscle


def fluid_volume(muscle: Any, length: Real, pressure: Real) -> RealArray:
    """Volume of fluid [m3] in a muscle: within the braid's outline, less the rubber.

    Args:
        muscle: with a `volume` of its own, as a `famjax.SafeMuscle`, or with a geometry.
        length: active length L [m].
        pressure: gauge pressure P [Pa].

    Returns:
        V [m3], broadcast shape; nan where the muscle has no state.

    Raises:
        InputError: the model has no geometry, as those of other authors.
    """
    if not hasattr(muscle, "volume"):
        raise InputError(
            f"a fluid volume needs a muscle with a geometry, got {type(muscle).__name__}: give a "
            "function of the gauge pressure [Pa] that returns the volume [m3] instead"
        )
    return muscle.volume(length, pressure)


class HeldLength(eqx.Module):
    """The volume of a muscle whose length is held: a function of the gauge pressure.

    Attributes:
        muscle: with a geometry.
        length: active length L [m].
    """

    muscle: AbstractMuscle
    length: Float[Given, ""] = eqx.field(converter=as_number)

    def __call__(self, pressure: Real) -> RealArray:
        """V [m3] at a gauge pressure P [Pa], of its shape."""
        return fluid_volume(self.muscle, self.length, pressure)


class HeldLoad(eqx.Module):
    """The volume of a muscle that moves a constant load: a function of the gauge pressure.

    The muscle is at every moment at the length at which it carries the load; the load's inertia is
    neglected.

    Attributes:
        muscle: with a geometry.
        load: [N].
    """

    muscle: AbstractMuscle
    load: Float[Given, ""] = eqx.field(converter=as_number)

    def __call__(self, pressure: Real) -> RealArray:
        """V [m3] at a gauge pressure P [Pa], of its shape; nan where it does not carry the load."""
        length = self.muscle.length_at_load(self.load, pressure, throw=False)
        return fluid_volume(self.muscle, length, pressure)
