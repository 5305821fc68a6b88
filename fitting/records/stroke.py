"""Strokes of a test: where the muscle shortens, where it lengthens, and at which set pressure."""

import dataclasses
import itertools

import numpy as np

from .isobaric_record import IsobaricRecord

_TURN = 0.3  # of the range of lengths at a pressure: a smaller motion is no stroke
_REST = 0.003  # of that range: what counts as being at an end


@dataclasses.dataclass(frozen=True)
class Stroke:
    """One stroke there and back.

    Attributes:
        set_pressure: [Pa].
        number: from 0, of those at this set pressure.
        shortening: rows of the concentric branch.
        lengthening: rows of the eccentric branch.
    """

    set_pressure: float
    number: int
    shortening: slice
    lengthening: slice


def strokes(record: IsobaricRecord) -> tuple[list[Stroke], list[str]]:
    """Every complete stroke of a record, and a sentence for each motion that is none.

    A stroke goes from the longest length to the shortest and back, by three tenths at least of the
    range of lengths at its set pressure.
    """
    found: list[Stroke] = []
    notes: list[str] = []
    for low, high in _held(record.set_pressure):
        pressure = float(record.set_pressure[low])
        length = record.length[low:high]
        turns = turning_points(length, _TURN * float(np.ptp(length)))
        branches = _branches(length, turns)
        k = count = 0
        while k < len(branches):
            start, end, shortens = branches[k]
            if shortens and k + 1 < len(branches):
                _, back, _ = branches[k + 1]
                again = branches[k + 1][0]
                whole = length[back - 1] > length[start] - 0.02 * float(np.ptp(length))
                if whole:
                    number = sum(s.set_pressure == pressure for s in found)
                    found.append(
                        Stroke(
                            pressure,
                            number,
                            slice(low + start, low + end),
                            slice(low + again, low + back),
                        )
                    )
                    count += 1
                    k += 2
                    continue
            notes.append(
                f"At {pressure:.6g} Pa a motion from {length[start]:.5g} m to {length[end - 1]:.5g} m "
                "is no complete stroke and was left out."
            )
            k += 1
        if not count and np.ptp(length) > 0.01 * record.rest_length:
            notes.append(f"At {pressure:.6g} Pa there is no complete stroke.")
    return found, notes


def _held(set_pressure: np.ndarray) -> list[tuple[int, int]]:
    """First and last+1 row of every stretch of one set pressure, nan left out."""
    edges = np.flatnonzero(np.diff(set_pressure) != 0) + 1
    bounds = [0, *edges.tolist(), set_pressure.size]
    stretches = itertools.pairwise(bounds)
    return [(a, b) for a, b in stretches if b - a > 2 and np.isfinite(set_pressure[a])]


def turning_points(x: np.ndarray, travel: float) -> list[int]:
    """Rows of alternating extremes between which x changes by `travel` or more, the outermost included."""
    turns: list[int] = []
    low = high = best = direction = 0
    for i, value in enumerate(x.tolist() if travel > 0 else ()):
        if direction == 0:
            low, high = (i if value < x[low] else low), (i if value > x[high] else high)
            if x[high] - x[low] >= travel:
                direction = 1 if high > low else -1
                turns, best = [min(low, high)], max(low, high)
        elif direction * (value - x[best]) > 0:
            best = i
        elif direction * (x[best] - value) >= travel:
            turns.append(best)
            best, direction = i, -direction
    return [*turns, best] if direction else []


def _branches(length: np.ndarray, turns: list[int]) -> list[tuple[int, int, bool]]:
    """First row, last+1 row and whether it shortens, of every motion between two turning points.

    Rests at either end are cut off: a branch leaves the last row, and ends at the first, that lies
    at the end's own length.
    """
    margin = _REST * float(np.ptp(length))
    branches = []
    for a, b in itertools.pairwise(turns):
        part = length[a : b + 1]
        shortens = bool(part[0] > part[-1])
        sign = 1.0 if shortens else -1.0
        at_start = np.flatnonzero(sign * (part[0] - part) <= margin)
        at_end = np.flatnonzero(sign * (part - part[-1]) <= margin)
        branches.append((a + int(at_start[-1]), a + int(at_end[0]) + 1, shortens))
    return branches
