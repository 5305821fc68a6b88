"""A suspicion: a fault in the data that would explain a misfit."""

import dataclasses

import numpy as np
from jaxtyping import Bool

from famjax.boundary.sentence import Sentence

from ..result import Identification

_COUNTED = 0.25  # of its weight: a reading that counts less lies 5 standard deviations off

FAR_BETTER = 3.0
"""Factor by which a change of the data must lower the misfit to be named."""

GOOD = 0.02
"""Misfit of a muscle by a good model, in parts of the largest force."""


@dataclasses.dataclass(frozen=True)
class Suspicion:
    """A fault in the data that would explain the misfit.

    Attributes:
        cause: what it is, in a few words.
        sentence: for a reader, with the figures.
        misfit: with the fault undone, in parts of the largest force.
        grave: nothing is identified from such data; otherwise it is a doubt.
    """

    cause: str
    sentence: str
    misfit: float
    grave: bool = True


def named(cause: str, here: float, better: float, *, grave: bool = True) -> Suspicion:
    """The suspicion of a cause that was undone.

    Args:
        cause: a clause.
        here: misfit of the map as it is, in parts of the largest force.
        better: likewise without the fault.
        grave: see `Suspicion`.
    """
    return Suspicion(
        cause,
        Sentence(
            "The data look wrong. It seems that ",
            cause,
            f": read so, the misfit is {100 * better:.2g} % of the largest force; as the file stands, "
            f"it is {100 * here:.2g} %.",
        ),
        better,
        grave,
    )


def counted(result: Identification) -> Bool[np.ndarray, " readings"]:
    """The loaded readings that are no outliers of Huber's objective; all of them without it."""
    return result.weights >= _COUNTED
