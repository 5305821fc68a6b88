"""What every static force model of another author offers here: a force at a length and pressure."""

import abc

import equinox as eqx

from .._types import Real, RealArray


class PeerModel(eqx.Module):
    """A static force model of a fluidic artificial muscle.

    The fields are its parameters, in SI. As with `famjax.Muscle`, the force is not clipped: a
    negative one means that a real muscle is slack.
    """

    @abc.abstractmethod
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
