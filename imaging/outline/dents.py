"""The outline without the dents that black threads make in one of its sides."""

import dataclasses

import numpy as np

from .both_sides import Outline
from .midline import off_smooth_midline
from .smoother import smooth

_ANY_BOW = 5  # coefficients of a mid-line that may be bowed: half a sine wave to a thousandth
_LONGER = 3.0  # times the outline's resolution: waves that no thread makes
_DEEPEST = 2.0  # px of the mid-line, beyond which no thread is what covers an end
_SEEN = 2.0  # robust standard deviations of the mid-line that make a dent
_SEEN_AT_END = 8.0  # the same at an end, which scatters more than twice as much


def without_dents(outline: Outline) -> Outline:
    """The outline, its dented parts as the other side is there.

    A black thread at the limb is as dark as the cloth: the edge is found where it ends, or where the
    thread beside it begins. That happens to one side at a time, and a body of revolution has a smooth
    mid-line. Where that leaves a smooth one by more than two standard deviations, the side that leaves
    its own smoother curve further is replaced by the other one's mirror image, between the rows in
    which the mid-line crosses the smooth one. At an end, where that curve is free to follow a dent, it
    is the side that lies further in, as far as threads reach, and only where that is clear: of two
    sides that scatter the inner one would be moved out. An outline of which no thread is hidden has no
    dents.
    """
    sides = outline.left, outline.right
    if not any(side.hidden for side in sides):
        return outline
    beside = [side.column - smooth(side.column, _LONGER * outline.resolution) for side in sides]
    off = off_smooth_midline(outline.left.column, outline.right.column, _ANY_BOW, robust=True)
    run = np.cumsum(np.append(0, np.diff(np.sign(off)) != 0)).astype(np.intp)
    furthest = np.zeros(run[-1] + 1)
    np.maximum.at(furthest, run, np.abs(off))
    spread = 1.4826 * float(np.median(np.abs(off)))
    dented = furthest > _SEEN * spread
    far = [np.bincount(run, np.abs(one)) for one in beside]
    on_left = far[0] > far[1]
    for end in (0, -1):
        dented[end] = furthest[end] > _SEEN_AT_END * spread
        if furthest[end] < _DEEPEST:
            on_left[end] = off[end] > 0
    wrong = dented & on_left, dented & ~on_left
    left, right = (
        dataclasses.replace(side, column=side.column - 2 * off * own[run])
        for side, own in zip(sides, wrong, strict=True)
    )
    return dataclasses.replace(outline, left=left, right=right)
