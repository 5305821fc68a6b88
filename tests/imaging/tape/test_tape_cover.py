"""Things that lie on a tape, shine on it, or touch the muscle: a right length, or an error."""

import functools

import cv2
import numpy as np
import pytest
from rendering import published_scene, random_scene
from slow_cases import slow_after

from imaging import ImagingError, Recipe, Scale, measure
from imaging.errors import MissingFitting
from tests.imaging.photographs import photograph

SIZE = (1325, 550)
SIGMAS = 3.0  # standard errors by which a length that is given may be off
SKIN, GREY, GLARE = (205, 150, 120), (40, 40, 40), (225, 235, 255)


@functools.cache
def photo(contraction=0.2, seed=31):
    return photograph(published_scene(contraction, size=SIZE), seed)


@functools.cache
def sound():
    return measure(photo().rgb, recipe())


def recipe():
    return Recipe(Scale.manual(photo().truth.px_per_m))


def covered(part, colour, above=None, below=0, lower=False):
    """A rectangle over the left part of a tape, from `above` px before its edge to `below` beyond."""
    u, v = sound().trace.lower if lower else sound().trace.upper
    inward = -1 if lower else 1
    left, edge = u.min() - 0.2 * np.ptp(u), v.mean()
    far = edge - inward * (60 if above is None else above)
    near = edge + inward * below
    corners = [(int(left), round(far)), (int(left + 1.4 * part * np.ptp(u)), round(near))]
    rgb = photo().rgb.copy()
    cv2.rectangle(rgb, *corners, colour, -1)
    return rgb


@pytest.mark.parametrize("lower", [False, True])
@pytest.mark.parametrize("colour", [SKIN, GREY, GLARE])
@pytest.mark.parametrize("part", [0.25, 0.5, 0.75])
@pytest.mark.parametrize("below", slow_after(2, [-3, 0, 2, 8]))
def test_a_covered_tape_gives_the_right_length_or_an_error(part, below, colour, lower):
    found = measured_or_refused(covered(part, colour, below=below, lower=lower))
    if isinstance(found, ImagingError):
        assert part > 0.25 or not isinstance(found, MissingFitting)
    else:
        assert abs(found.length - photo().truth.length) < SIGMAS * found.length_stderr


def measured_or_refused(rgb):
    try:
        return measure(rgb, recipe())
    except ImagingError as error:
        return error


@pytest.mark.parametrize("seed", [301, 302, 303])
def test_nothing_covers_a_tape_that_lies_open(seed):
    scene = random_scene(seed, px_per_in=(90.0, 130.0))
    camera = scene.camera
    how = Recipe(Scale.manual(camera.px_per_m), distance=camera.distance, centre=camera.centre)
    found = measure(photograph(scene, seed).rgb, how)
    assert found.quality.axis_kink < 0.03  # 0.05 is refused
