"""How an inverse map ended, as a code that survives a batch and as a sentence."""

import enum
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer


class Outcome(enum.IntEnum):
    """How an inverse map ended; `message` says what to do about it.

    Results carry it as an integer array `code`, so that one point of a batch that cannot be reached
    leaves the others as they are. `FEASIBLE` is 0. As text an outcome is its name, a colon and its
    message; `Outcome.words` has those of codes, be they one or an array of any shape.

    >>> print(Outcome(2).name, "/", Outcome.FEASIBLE)
    FORCE_HIGH / FEASIBLE: what was asked for is attained
    >>> Outcome.words([0, 2])
    array(['FEASIBLE', 'FORCE_HIGH'], dtype='<U10')
    """

    FEASIBLE = 0
    FORCE_LOW = 1
    FORCE_HIGH = 2
    STIFFNESS_LOW = 3
    STIFFNESS_HIGH = 4
    TORQUE_LOW = 5
    TORQUE_HIGH = 6
    SLACK = 7
    NO_STATE = 8
    MOMENT_ARM = 9
    NO_EQUILIBRIUM = 10
    BEYOND_LINE = 11
    BEYOND_ANGLES = 12

    def __str__(self) -> str:
        return f"{self.name}: {self.message}"

    @property
    def message(self) -> str:
        """A full sentence with a remedy."""
        return _MESSAGES[self]

    @classmethod
    def words(cls, codes: Any, *, messages: bool = False) -> Any:
        """The names of codes.

        Args:
            codes: of a result, an integer or an array of integers of any shape; not traced.
            messages: the full sentences as well, each after its name.

        Returns:
            A text for one code, or an array of texts of the codes' shape.

        Raises:
            ValueError: a number that is no code.
        """
        given = np.asarray(codes)
        texts = [str(one) if messages else one.name for one in map(cls, given.ravel().tolist())]
        return np.array(texts).reshape(given.shape) if given.ndim else texts[0]


class Answer(eqx.Module):
    """A result with codes: shows its numbers, and the codes as words.

    Attributes:
        code: an `Outcome` of each member.
    """

    code: eqx.AbstractVar[jax.Array]

    @property
    def outcome(self) -> Any:
        """The codes' names: a text for one code, or an array of texts; not while JAX traces."""
        return Outcome.words(self.code)

    def __repr__(self) -> str:
        leaves = {name: getattr(self, name) for name in self.__dataclass_fields__}
        if any(isinstance(one, Tracer) or not hasattr(one, "dtype") for one in leaves.values()):
            return eqx.tree_pformat(self)
        shown = {name: _shown(one) for name, one in leaves.items() if name != "code"}
        shown["outcome"] = str(self.outcome).replace("\n", "")
        return f"{type(self).__name__}({', '.join(f'{k}={v}' for k, v in shown.items())})"


def _shown(values: Any) -> str:
    if np.ndim(values) == 0:
        return f"{float(values):.6g}"
    text = np.array2string(
        np.asarray(values), precision=6, threshold=12, edgeitems=3, separator=", "
    )
    return " ".join(text.split())


_MESSAGES = {
    Outcome.FEASIBLE: "what was asked for is attained",
    Outcome.FORCE_LOW: (
        "the force is less than the muscle pulls at any allowed pressure, or a push: ask for more, "
        "lower the least pressure, or shorten the muscle"
    ),
    Outcome.FORCE_HIGH: (
        "the force is more than the muscle pulls at any allowed pressure: ask for less, raise the "
        "highest pressure, or lengthen the muscle"
    ),
    Outcome.STIFFNESS_LOW: (
        "the joint is stiffer than that at any pressures that give the torque: ask for at least "
        "stiffness_range(angle, torque).lowest; to come below it lower the lowest pressure or "
        "least_pull, or take smaller moment arms"
    ),
    Outcome.STIFFNESS_HIGH: (
        "the joint is softer than that at any pressures that give the torque: ask for at most "
        "stiffness_range(angle, torque).highest; to come above it raise the highest pressure, or "
        "take larger moment arms"
    ),
    Outcome.TORQUE_LOW: (
        "the torque is below all that the pair has at that angle with both muscles taut: see "
        "torque_range"
    ),
    Outcome.TORQUE_HIGH: (
        "the torque is above all that the pair has at that angle with both muscles taut: see "
        "torque_range"
    ),
    Outcome.SLACK: (
        "a muscle does not reach the least pull at the highest pressure, or pulls no more for more "
        "pressure: it is too short at that angle; lengthen its path"
    ),
    Outcome.NO_STATE: (
        "the muscle has no force at that length, or an input is not a number: look for nan among "
        "the inputs, and compare the length, path.length(angle) of a joint, with "
        "muscle.length_range(); a safe muscle, card.safe() or famjax.muscles, has a force at every "
        "length"
    ),
    Outcome.MOMENT_ARM: (
        "the flexor's moment arm must be positive and the extensor's negative at that angle: the "
        "lever has passed its dead centre, or the paths are exchanged"
    ),
    Outcome.NO_EQUILIBRIUM: (
        "the torque does not fall through the load within the angles of the joint: lower the load, "
        "or widen the angles"
    ),
    Outcome.BEYOND_LINE: (
        "the line does not get there: filling needs an end between the start and the supply, "
        "venting one between atmosphere and the start"
    ),
    Outcome.BEYOND_ANGLES: (
        "the angle is outside the joint's own, Antagonist.angles: ask within them, or widen them if "
        "the joint turns further"
    ),
}
