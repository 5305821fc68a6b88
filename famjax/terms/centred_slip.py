"""Maxwell-slip elements about a static map that is the middle of its cycles."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Num

from .._types import Real, RealArray, as_real
from .maxwell_slip import MaxwellSlip, SlipState
from .slip_elements import Either, slip, slip_shares

Cycle = Literal["ramp", "stroke"]
"""Pressure up and down at one length, or shorter and longer at one pressure."""


def there_and_back(path: Sequence[Either], threshold: Either) -> tuple[Either, Either]:
    """Deflections of relaxed elements when a path reaches a point, turns round and comes back to it.

    Args:
        path: coordinate at the start, at other ends of motions, at the point, at the turn and at the
            point again. Between two of them it moves one way.
            Arrays of one shape (*n,), NumPy's or JAX's.
        threshold: of the elements, shape (k,).

    Returns:
        (deflection on the way there, and on the way back), shape (*n, k).
    """
    s: list[Either] = [0.0 * path[0][..., None] * threshold]
    for before, after in itertools.pairwise(path):
        s.append(slip(s[-1], (after - before)[..., None], threshold))
    return s[-3], s[-1]


@dataclasses.dataclass(frozen=True)
class ReferenceCycle:
    """The cycle whose branches the static map is the mean of.

    Attributes:
        kind: what moves, the pressure or the length.
        start, turn: ends of the motion, gauge pressures [Pa] or lengths [m].
        cycled: the same cycle went before; otherwise all is relaxed at the start.
    """

    kind: Cycle
    start: float
    turn: float
    cycled: bool


class CentredSlip(eqx.Module):
    """Hysteresis about a static map: zero mean over both branches of the map's own cycles.

    The mean of two branches is not where relaxed elements would be: below their thresholds they
    are springs. Their mean over the cycle, which depends on length and pressure alone, is
    therefore subtracted: a static force, which changes neither branch against the other.

    Attributes:
        slip: the elements.
        cycle: of the static map.
    """

    slip: MaxwellSlip
    cycle: ReferenceCycle = eqx.field(static=True)

    def middle(
        self, length: Num[Array | np.ndarray, "*n"], pressure: Num[Array | np.ndarray, "*n"]
    ) -> Float[Array, "*n"]:
        """Mean [N] of the elements' force over both branches of the cycle through a point.

        Beyond the turn of the reference cycle, the cycle turns at the point itself.
        """
        there, back = self._ends(length, pressure)
        start, at, turn = (
            self.slip.coordinates(*where) for where in (there, (length, pressure), back)
        )
        shares = slip_shares(jnp.asarray(pressure), self.slip.modulus)
        before = [start, turn] if self.cycle.cycled else []
        total = jnp.zeros(())
        for k, elements in enumerate((self.slip.wall, self.slip.braid)):
            path = [one[k] for one in (*before, start, at, turn, at)]
            out, home = there_and_back(path, elements.threshold)
            total = total + shares[k] * elements.force(jnp.asarray(out + home) / 2)
        return total

    def start(self, length: Real, pressure: Real) -> SlipState:
        """The state in which a history begins at a length [m] and a pressure [Pa], both scalars.

        Reached from the start of the reference cycle: from the vented muscle of that length, or from
        the longest length under that pressure. After a cycle, if one went before.
        """
        there, back = self._ends(as_real(length), as_real(pressure))
        state = self.slip.start(*there)
        for at in [back, there] if self.cycle.cycled else []:
            state = self.slip.moved(state, *at)
        return self.slip.moved(state, length, pressure)

    def added(self, state: SlipState, length: Real, pressure: Real) -> RealArray:
        """What the history adds to the static map [N] in a state at that length and pressure."""
        return self.slip.force(state, pressure) - self.middle(as_real(length), as_real(pressure))

    def along(
        self, length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
    ) -> Float[Array, " n"]:
        """Hysteresis [N] to be added to the static map along a history, shape (n,).

        The history begins where the reference cycle does: vented at the first length, or at the
        longest length under the first pressure.

        Args:
            length: L [m] in the order of time, shape (n,); every turning point must be among them.
            pressure: gauge pressure P [Pa], shape (n,).
        """
        there, back = self._ends(length[:1], pressure[:1])
        first = [there, back, there] if self.cycle.cycled else [there]
        L = np.concatenate([*(np.asarray(at[0]) for at in first), length])
        P = np.concatenate([*(np.asarray(at[1]) for at in first), pressure])
        return self.slip.along(L, P)[len(first) :] - self.middle(length, pressure)

    def _ends(
        self, length: Num[Array | np.ndarray, "*n"], pressure: Num[Array | np.ndarray, "*n"]
    ) -> tuple[tuple, tuple]:
        """Length and pressure at the start and at the turn of the cycle through each point."""
        if self.cycle.kind == "ramp":
            low, high = jnp.minimum, jnp.maximum
            return (
                (length, low(pressure, self.cycle.start)),
                (length, high(pressure, self.cycle.turn)),
            )
        return (
            (jnp.maximum(length, self.cycle.start), pressure),
            (jnp.minimum(length, self.cycle.turn), pressure),
        )
