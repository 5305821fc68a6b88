"""Which of a picture's regular strips is the ruler's scale, and whether there is only one."""

import dataclasses
from typing import Any

import numpy as np

from ..arrays import Image, Single
from ..errors import AmbiguousRuler, RulerNotFound
from .marks import Numbered, marks_of, numbered
from .strip import Line, regular_strips

FEWEST = 8
_INCH = 0.0254  # [m]
_ON_MODEL = 0.8  # of the marks between the first and the last
_AT_ALL = 0.5  # of them, from which another scale may not be passed over
_SHARP = 0.05  # pitches; marks that scatter more are none of a ruler
_EXPECTED = 0.25  # relative, by which the scale that is expected may be off
_SAME = 0.03  # relative, by which two pitches, or a multiple of one, may differ
_AS_EXACT = (3.0, 0.1)  # times, px
_STRAND = 3.0  # px, width of the lines along which marks are followed from strip to strip
_ON_MARK = 0.12  # pitches by which a mark may seem to wander between two strips


@dataclasses.dataclass(frozen=True)
class Strip:
    """A strip of a ruler with its marks.

    Attributes:
        line: where it is.
        marks: on it.
    """

    line: Line
    marks: Numbered


def choose_strip(luma: Image, light: Single, pitch: float, expected: float | None) -> Strip:
    """The strip with the most marks of those that have the scale to expect.

    Args:
        luma: picture, shape (h, w).
        light: the same in linear light.
        pitch: of the marks [m].
        expected: scale [px/m]; None expects that of the finest marks, and no other.

    Raises:
        RulerNotFound: no strip has 8 marks at even distances, or none of the scale expected.
        AmbiguousRuler: no scale is expected, and another edge shows another one.
    """
    lines = regular_strips(luma)
    strips = [strip for line in lines if (strip := read_strip(light, line)) is not None]
    good = [strip for strip in strips if is_ruler(strip.marks)]
    if expected is not None:
        near = expected * pitch
        good = [strip for strip in good if abs(strip.marks.pitch / near - 1) < _EXPECTED]
    if not good:
        figures: dict[str, Any] = {
            "marks": max((strip.marks.number.size for strip in strips), default=0),
            "strips": len(lines),
        }
        if expected is not None:
            figures["expected_pitch_px"] = expected * pitch
        raise RulerNotFound(
            f"a ruler must show {FEWEST} or more marks at even distances, {_ON_MODEL:.0%} of those "
            "between the first and the last; is it in the picture, in focus, and is the pitch that "
            "of its finest regular marks?",
            **figures,
        )
    best = max(good, key=lambda strip: (strip.marks.number.size, strip.line.width))
    if expected is None:
        _check_unique(light, best, strips, pitch)
    return best


def read_strip(light: Single, line: Line) -> Strip | None:
    """A strip's marks, None where they cannot be numbered."""
    marks = numbered(marks_of(line.profile(light), line.pitch), line.pitch)
    return None if marks is None else Strip(line, marks)


def is_ruler(marks: Numbered) -> bool:
    """Whether marks are many, even and sharp enough."""
    return (
        marks.number.size >= FEWEST
        and marks.number.size >= _ON_MODEL * marks.expected
        and marks.residual <= _SHARP * marks.pitch
    )


def _check_unique(light: Single, best: Strip, strips: list[Strip], pitch: float) -> None:
    """Every other strip must show the same marks, or the longer ones of them."""
    others = [
        strip
        for strip in strips
        if abs(strip.line.along @ best.line.along) > 0.99
        and strip.marks.number.size >= max(FEWEST, _AT_ALL * strip.marks.expected)
        and strip.marks.residual <= _SHARP * strip.marks.pitch
    ]
    alike = [strip for strip in others if abs(strip.marks.pitch / best.marks.pitch - 1) < _SAME]
    for other in others:
        ratio = max(other.marks.pitch, best.marks.pitch) / min(other.marks.pitch, best.marks.pitch)
        whole = abs(ratio / round(ratio) - 1) < _SAME
        if whole and (
            round(ratio) == 1
            or not _as_exact(other, best)
            or any(_run_together(light, fine, other) for fine in alike)
        ):
            continue
        raise AmbiguousRuler(
            "the picture must show one scale; two edges of the ruler differ, and the pitch that was "
            "given can be that of either: say which scale to expect (expected_px_per_m, "
            "--expected-px-per-in), or cover one edge",
            pitch_px=best.marks.pitch,
            other_pitch_px=other.marks.pitch,
            px_per_in=best.marks.pitch / pitch * _INCH,
            other_px_per_in=other.marks.pitch / pitch * _INCH,
        )


def _as_exact(strip: Strip, best: Strip) -> bool:
    """Whether what repeats itself can be marks: the numbers beside every eighth do not as well."""
    times, more = _AS_EXACT
    return strip.marks.residual <= times * best.marks.residual + more


def _run_together(light: Single, fine: Strip, coarse: Strip) -> bool:
    """Whether the marks of a strip go on to that of the finer ones: they are its longer marks."""
    across = coarse.line.across
    way = float((fine.line.origin - coarse.line.origin) @ across)
    for part in (0.25, 0.5, 0.75):
        origin = coarse.line.origin + part * way * across
        line = dataclasses.replace(coarse.line, origin=origin, width=_STRAND)
        seen = marks_of(line.profile(light), coarse.line.pitch)
        if seen.size == 0:
            return False
        off = np.abs(coarse.marks.place[:, None] - seen).min(axis=1)
        if np.mean(off < _ON_MARK * coarse.marks.pitch) < 0.5:
            return False
    return True
