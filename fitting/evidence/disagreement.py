"""What models that fit the readings alike disagree about, between the readings."""

from collections.abc import Collection

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.sentence import Quantity, Sentence

from ..data.force_data import ForceData
from .pull import force_of

TELLING = 0.03
"""Of the largest force: a disagreement of so much is worth a reading that settles it."""
_STATES = 9  # in each gap between lengths


def disagreement(
    force: Float[np.ndarray, " n"],
    alike: Collection[famjax.MountedMuscle],
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Root mean square difference [N] of muscles from a force; 0 where there are none.

    Args:
        force: of the model that predicts [N].
        alike: muscles, in their rigs, that fit the readings as well.
        length: [m].
        pressure: gauge [Pa].
    """
    if not alike:
        return np.zeros_like(force)
    # A muscle that has no force at a state says nothing of it.
    others = np.stack([force_of(one, length, pressure) for one in alike])
    squares = np.where(np.isfinite(others), (others - force) ** 2, 0.0)
    return np.sqrt(squares.sum(axis=0) / np.maximum(np.isfinite(others).sum(axis=0), 1))


def where_they_differ(
    data: ForceData, chosen: famjax.MountedMuscle, alike: Collection[famjax.MountedMuscle]
) -> Sentence | str:
    """Where models that fit the readings alike differ most between the measured lengths, if it is much.

    Args:
        data: the map.
        chosen: the model that predicts.
        alike: see `disagreement`.

    Returns:
        A sentence that names the readings that would settle it; "" where they agree to 3 % of the
        largest force.
    """
    lengths = np.unique(data.lengths.level[data.loaded])
    if not alike or lengths.size < 2:
        return ""
    part = np.arange(1, _STATES) / _STATES
    between = (lengths[:-1, None] + part * np.diff(lengths)[:, None]).ravel()
    highest = np.array([data.pressure[data.loaded].max()])
    L, P = (one.ravel() for one in np.meshgrid(between, highest, indexing="ij"))
    force = force_of(chosen, L, P)
    differ = np.where(force > 0, disagreement(force, alike, L, P), 0.0)
    worst = int(np.argmax(differ))
    if not differ[worst] > TELLING * data.max_force:
        return ""
    gap = worst // part.size
    low, high = lengths[gap], lengths[gap + 1]
    return Sentence(
        "Models that fit the readings alike differ by ",
        Quantity(float(differ[worst]), "force", 2),
        f" ({100 * differ[worst] / data.max_force:.2g} % of the largest force) between the lengths ",
        Quantity(float(low), "length"),
        " and ",
        Quantity(float(high), "length"),
        ", most at ",
        Quantity(float(L[worst]), "length", 4),
        ": readings at one more length there would settle it; until then trust the band, not the curve.",
    )
