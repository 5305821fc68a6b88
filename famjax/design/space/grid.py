"""The candidates of a search by their number: pair, nominal diameter, rest length, pressure."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .limits import SearchRanges
from .pairs import BuildablePair

AXES = ("nominal_diameter", "pressure", "rest_length")
"""What is varied; the last runs fastest, as contractions do not depend on the rest length."""

_WIDTH = 64  # states are counted in multiples of it: one shape for chunks that differ by a few


@dataclasses.dataclass(frozen=True)
class SearchGrid:
    """A grid for each pair, one after the other; the last of `AXES` runs fastest.

    Every pair has the same share of the candidates. What is fixed has one point, what is varied has
    as many as the share allows, alike on every axis but for a rest that goes to the last one.

    Attributes:
        low: (pairs, 3), least nominal diameter [m], pressure [Pa] and rest length [m].
        high: (pairs, 3), the greatest.
        counts: (pairs, 3), points on each axis.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, pairs: Sequence[BuildablePair], ranges: SearchRanges, about: int) -> "SearchGrid":
        """The grid with at most `about` candidates, and at least one for each pair."""
        ends = [(pair.nominal_range, ranges.pressure, ranges.rest_length) for pair in pairs]
        low, high = np.moveaxis(np.reshape(ends, (-1, 3, 2)).astype(np.float64), 2, 0)
        share = max(1, about // max(1, len(pairs)))
        counts = [_points(varied, share) for varied in (high > low).tolist()]
        return cls(low, high, np.reshape(counts, (-1, 3)).astype(np.int64))

    @property
    def total(self) -> int:
        """Number of candidates."""
        return int(self.counts.prod(1).sum())

    def most_states(self, chunk: int) -> int:
        """Bound of the pairs, nominal diameters and pressures among so many candidates in a row."""
        shortest = int(self.counts[:, -1].min(initial=chunk))
        return -(-(chunk // shortest + 2) // _WIDTH) * _WIDTH

    def candidates(self, index: NDArray[np.int64]) -> dict[str, NDArray]:
        """Pair and varied numbers of some candidates.

        Args:
            index: their numbers, (n,), in [0, total).

        Returns:
            `pair` and the three axes by name, each (n,), in SI.
        """
        sizes = self.counts.prod(1)
        ends = np.cumsum(sizes)
        pair = np.searchsorted(ends, index, side="right")
        within = index - (ends - sizes)[pair]
        found: dict[str, NDArray] = {"pair": pair}
        for k in reversed(range(len(AXES))):
            count = self.counts[pair, k]
            within, at = np.divmod(within, count)
            share = at / np.maximum(count - 1, 1)
            low, high = self.low[pair, k], self.high[pair, k]
            # The ends themselves, to the last digit.
            found[AXES[k]] = np.where(share == 1, high, low + share * (high - low))
        return found


def _points(varied: list[bool], share: int) -> list[int]:
    """Points on each axis of a pair."""
    each = max(1, math.floor(share ** (1 / max(1, sum(varied))) * (1 + 1e-12)))
    counts = [each if one else 1 for one in varied]
    if any(varied):
        last = max(k for k, one in enumerate(varied) if one)
        others = math.prod(counts) // counts[last]
        counts[last] = max(1, share // others)
    return counts
