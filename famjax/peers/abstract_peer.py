"""Base class of published static force models, and what several of them share.

A new one has its parameters as fields, `force(length, pressure)` and `length_range()`, where it holds.
"""

import math

import jax.numpy as jnp

from .._types import Real, RealArray
from ..braids.inextensible import NEUTRAL_ANGLE, AbstractBraid
from ..muscle import AbstractMuscle


class PeerModel(AbstractMuscle):
    """A static force model of a fluidic artificial muscle.

    The fields are its parameters, in SI. As with `famjax.Muscle`, the force is not clipped: a
    negative one means that a real muscle is slack.
    """


def braid_range(braid: AbstractBraid) -> tuple[RealArray, RealArray]:
    """From just below the neutral angle to the length [m] of the unloaded threads."""
    thread = braid.rest_thread_length
    return 0.95 * math.sin(NEUTRAL_ANGLE) * thread, thread


def around_rest(rest_length: RealArray) -> tuple[RealArray, RealArray]:
    """From half the rest length [m] to a tenth above it: beyond what muscles do."""
    return 0.5 * rest_length, 1.1 * rest_length


def known(rest_length: RealArray | None, model: AbstractMuscle) -> RealArray:
    """The rest length of a model that works without one.

    Raises:
        ValueError: it was not given.
    """
    if rest_length is None:
        raise ValueError(
            f"the force of {type(model).__name__} knows no rest length, so that it has neither a "
            "blocked force nor a contraction; give it resting_length [m]"
        )
    return rest_length


def at_positive(length: Real, force: RealArray) -> RealArray:
    """The force [N], nan where the length is not positive."""
    return jnp.where(jnp.asarray(length) > 0, force, jnp.nan)
