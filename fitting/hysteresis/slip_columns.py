"""Half-differences of single elements: what their strengths are fitted by."""

import numpy as np
from jaxtyping import Float

from famjax.slip import slip_coordinates, slip_shares, there_and_back

from .branch_pairs import BranchPairs

MODULUS = 1e6
"""E [Pa] of the coordinates, the order of rubber's: see `famjax.slip.MaxwellSlip`."""

_ELEMENTS = 8  # thresholds on each coordinate
_OCTAVES = 7  # from the highest to the lowest of them

Thresholds = tuple[Float[np.ndarray, " k"], Float[np.ndarray, " m"]]
"""Of the elements on the wall's coordinate and of those on the braid's."""


def threshold_grid(pairs: BranchPairs, modulus: float = MODULUS) -> Thresholds:
    """Eight thresholds on each coordinate, each twice the one before.

    The highest is half the largest range of a record: only below it an element slides both ways.
    A coordinate that no record moves has none.

    Args:
        pairs: the records.
        modulus: E [Pa].
    """
    start, turn = (_coordinates(pairs, place, modulus) for place in ("start_", "turn_"))
    ranges = [float(np.abs(b - a).max()) for a, b in zip(start, turn, strict=True)]
    factors = 2.0 ** np.linspace(-_OCTAVES, 0, _ELEMENTS)
    wall, braid = (span / 2 * factors if span > 0 else np.zeros(0) for span in ranges)
    return wall, braid


def half_difference_columns(
    pairs: BranchPairs, thresholds: Thresholds, modulus: float
) -> Float[np.ndarray, "n elements"]:
    """Half-difference [N] of each element per strength, in the order of the thresholds."""
    start, at, turn = (_coordinates(pairs, place, modulus) for place in ("start_", "", "turn_"))
    shares = slip_shares(pairs.pressure, modulus)
    columns = []
    for k, delta in enumerate(thresholds):
        before = np.where(pairs.cycled, turn[k], start[k])
        out, home = there_and_back([start[k], before, start[k], at[k], turn[k], at[k]], delta)
        columns.append(np.asarray(shares[k])[:, None] * np.asarray(home - out) / 2 / delta)
    return np.concatenate(columns, axis=1)


def _coordinates(
    pairs: BranchPairs, place: str, modulus: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Of wall and braid at the start, at the turn or at the point."""
    L, P = (getattr(pairs, f"{place}{name}") for name in ("length", "pressure"))
    wall, braid = slip_coordinates(L, P, pairs.rest_length, modulus)
    return np.asarray(wall), np.asarray(braid)
