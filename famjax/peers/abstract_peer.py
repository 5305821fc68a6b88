"""Base class of published static force models, and what several of them share.

A new one has its parameters as fields, `force(length, pressure)` and `length_range()`, where it holds.
"""

import functools
import math
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from .._arrays import Real, RealArray, as_real
from ..braids import NEUTRAL_ANGLE, AbstractBraid
from ..muscle import AbstractMuscle

_Force = TypeVar("_Force", bound=Callable[..., Any])
_ANY_PRESSURE = 1e5  # Pa, at which every model has a force


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


def where_it_holds(formula: _Force) -> _Force:
    """A model's force, nan where length or pressure are no numbers, or the length is not positive.

    The formula is asked of other numbers there: nan itself would spoil, in reverse mode, the derivatives
    of all other members of a batch.
    """

    @functools.wraps(formula)
    def force(self: Any, length: Real, pressure: Real) -> RealArray:
        L, P = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        holds = (L > 0) & jnp.isfinite(L) & jnp.isfinite(P)
        middle = jax.lax.stop_gradient(sum(self.length_range()) / 2)
        found = formula(self, jnp.where(holds, L, middle), jnp.where(holds, P, _ANY_PRESSURE))
        return jnp.where(holds, found, jnp.nan)

    return force  # type: ignore[return-value] # of the formula's own signature
