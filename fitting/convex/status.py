"""How a convex fit ended, as a code that survives a batch and as a sentence."""

import enum


class Status(enum.IntEnum):
    """How a quadratic programme ended; `message` says what to do about it."""

    OPTIMAL = 0
    RANK_DEFICIENT = 1
    INFEASIBLE = 2
    STALLED = 3

    @property
    def message(self) -> str:
        """A full sentence with a remedy."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OPTIMAL: "the optimum was found and certified",
    Status.RANK_DEFICIENT: (
        "the data cannot tell the coefficients apart: use a lower order, fewer pressure-dependent "
        "coefficients, or readings at more lengths"
    ),
    Status.INFEASIBLE: (
        "no coefficients satisfy the constraints: the bounds on the coefficients contradict the "
        "constraint, or one another; widen them or choose a weaker constraint"
    ),
    Status.STALLED: (
        "the active set kept changing: check the data for columns of very different size, "
        "or constraint rows that are nearly the same"
    ),
}
