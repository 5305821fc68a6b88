"""How many marks a ruler has from number to number, and what pitch that makes of them."""

from collections import Counter

import cv2
import numpy as np

from ..arrays import Array, Single
from ..errors import AmbiguousRuler
from .choice import Strip
from .strip import Line

_INCH = 0.0254  # [m]
_PERIODS = (2, 4, 5, 8, 10, 16, 20, 32, 64)
_READINGS = {
    8: (0.125 * _INCH,), 16: (0.0625 * _INCH,), 32: (_INCH / 32,), 64: (_INCH / 64,),
    10: (0.001, 0.1 * _INCH), 20: (0.0005, 0.05 * _INCH),
}  # fmt: skip
"""Pitches [m] of marks that are numbered at every so many: inches in powers of two, centimetres,
inches in tenths and twentieths. Every fourth mark is longer on most rulers, and tells nothing."""

_REACH = 24  # pitches across, within which a ruler has its longest marks and its numbers
_STEP = 0.25  # pitches
_SUPPORT = 0.5  # of the lines that the period seen on most has, without which another is chance
_FEWEST = 4  # numbers
_CLEAR = 0.6  # of the ink's variance from mark to mark, that its period explains
_AS_CLEAR = 0.75  # of the clearest period
_INK = 0.15  # of the light on the face
_EXPECTED = 0.25  # relative, by which the scale that is expected may be off


def pitch_of(light: Single, strip: Strip, expected: float | None) -> float:
    """The pitch of a ruler's marks [m] by the number of marks from number to number.

    Args:
        light: linear light of the picture, shape (h, w).
        strip: the marks.
        expected: scale to within a quarter [px/m], which decides between two readings.

    Raises:
        AmbiguousRuler: no numbers or longest marks are seen, or they can be read in two ways.
    """
    period = marks_per_number(light, strip)
    readings = _READINGS.get(period or 0, ())
    if expected is not None:
        near = strip.marks.pitch / expected
        readings = tuple(one for one in readings if abs(one / near - 1) < _EXPECTED)
    if len(readings) == 1:
        return readings[0]
    if readings:
        raise AmbiguousRuler(
            f"every {period}th mark is numbered, as on a ruler in millimetres and on one in tenths of an "
            "inch: is the pitch 1 mm or 0.1 in? Say --pitch 1mm or --pitch 0.1in",
            pitch_px=strip.marks.pitch,
        )
    seen = (
        "no numbers and no longest marks are seen that would tell the pitch"
        if period is None
        else f"every {period}th mark is longest or numbered, which is no ruler's that is known"
    )
    raise AmbiguousRuler(
        f"how far is it from mark to mark? {seen}: say --pitch 0.125in, 1mm, or what the ruler has",
        pitch_px=strip.marks.pitch,
    )


def marks_per_number(light: Single, strip: Strip) -> int | None:
    """Marks from number to number, or from one longest mark to the next; None where none are seen.

    Along lines beside the marks the ink about each mark's place is summed. Its period on each line is
    the shortest one that explains nearly all that any explains; the longest of all lines' periods is
    that of the numbers, since all shorter marks repeat themselves more often.
    """
    line, marks = strip.line, strip.marks
    first, last = int(marks.number.min()), int(marks.number.max())
    face = max(float(np.percentile(line.profile(light), 80)), 1e-6)
    away = np.arange(-_REACH, _REACH + _STEP, _STEP) * line.pitch
    ink = _ink(_beside(light, line, away), marks.coefficients, first, last) / face
    counts = Counter(period for period in _periods(ink) if period)
    most = max(counts.values(), default=0)
    return max((one for one, n in counts.items() if n >= max(2, _SUPPORT * most)), default=None)


def _beside(light: Single, line: Line, away: Array) -> Array:
    """Light along lines so far across from another [px], three pixels wide, shape (lines, samples).

    Between pixels: a line of the nearest ones goes up and down an edge that it lies along, in steps as
    regular as a ruler's numbers.
    """
    at = np.arange(line.samples)
    across = (away[:, None] + np.arange(-1.0, 2.0)).reshape(-1, 1)
    u, v = (
        (line.origin[i] + at * line.along[i] + across * line.across[i]).astype(np.float32)
        for i in (0, 1)
    )
    seen = cv2.remap(light, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen, float).reshape(away.size, 3, -1).mean(axis=1)


def _ink(profiles: Array, fit: Array, first: int, last: int) -> Array:
    """Ink about each mark's place, the mean of what differs from most of its line, (lines, marks)."""
    a, b, c = fit
    at = (np.arange(first - 0.5, last + 1) * b + a) / (1 + c * np.arange(first - 0.5, last + 1))
    edges = np.clip(np.sort(np.rint(at)).astype(int), 0, profiles.shape[1])
    inside = profiles[:, edges[0] : max(edges[-1], edges[0] + 1)]
    differs = np.abs(profiles - np.median(inside, axis=1, keepdims=True))
    total = np.pad(np.cumsum(differs, axis=1), ((0, 0), (1, 0)))
    ink = np.diff(total[:, edges], axis=1) / np.maximum(np.diff(edges), 1)
    return ink if b > 0 else ink[:, ::-1]


def _periods(ink: Array) -> list[int | None]:
    """The shortest period that explains the ink about the marks of each line; None where none does."""
    most = np.sort(ink, axis=1)[:, -_FEWEST:].min(axis=1, keepdims=True)
    ink = np.minimum(ink, 0.7 * most)  # an 8 is no more than a 1
    known = [n for n in _PERIODS if ink.shape[1] >= _FEWEST * n]
    explained = np.zeros((len(ink), len(known)))
    for k, n in enumerate(known):
        whole = ink[:, : ink.shape[1] // n * n].reshape(len(ink), -1, n)
        mean, size = whole.mean(axis=1, keepdims=True), whole[0].size
        left = np.sum((whole - mean) ** 2, axis=(1, 2)) / max(size - n, 1)
        spread = np.var(whole, axis=(1, 2)) * size / (size - 1)
        seen = (spread > 0) & (np.ptp(mean[:, 0], axis=1) > _INK / 4)
        explained[seen, k] = 1 - left[seen] / spread[seen]
    best = explained.max(axis=1, initial=0.0)
    near = explained >= np.maximum(_AS_CLEAR * best, 1e-300)[:, None]
    return [
        known[int(np.argmax(row))] if clear >= _CLEAR else None
        for row, clear in zip(near, best, strict=True)
    ]
