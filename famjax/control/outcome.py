"""How an inverse map ended, as a code that survives a batch and as a sentence."""

import enum


class Outcome(enum.IntEnum):
    """How an inverse map ended; `message` says what to do about it.

    Results carry it as an integer array `code`, so that one point of a batch that cannot be reached
    leaves the others as they are. `FEASIBLE` is 0.

    >>> Outcome(2).name, Outcome.FEASIBLE.message
    ('FORCE_HIGH', 'what was asked for is attained')
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

    @property
    def message(self) -> str:
        """A full sentence with a remedy."""
        return _MESSAGES[self]


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
        "the joint is stiffer than that at any pressures that give the torque: ask for more "
        "stiffness, or for less least pull"
    ),
    Outcome.STIFFNESS_HIGH: (
        "the joint is softer than that at any pressures that give the torque: ask for less "
        "stiffness, or raise the highest pressure"
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
        "the muscle has no force at that length: it lies outside the muscle's range, or an input is "
        "not a number"
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
}
