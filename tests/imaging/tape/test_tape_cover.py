"""Things that lie on a tape, shine on it, or touch the muscle: a right length, or an error."""

import dataclasses
import functools

import cv2
import numpy as np
import pytest
from rendering import INCH, Lens, Tape, published_scene, random_scene
from slow_cases import slow_after

from imaging import ImagingError, Recipe, Scale, Tone, measure
from imaging.ends import tape_shows
from imaging.errors import DamagedImage, MissingFitting, MotionBlurred
from imaging.outline import axis_deviation, axis_kink
from tests.imaging.photographs import photograph

SIZE = (1325, 550)
SIGMAS = 3.0  # standard errors by which a length that is given may be off
SKIN, GREY, GLARE = (205, 150, 120), (40, 40, 40), (225, 235, 255)
BLUE, TAN = np.array([40.0, 90.0, 190.0]), np.array([200.0, 180.0, 130.0])


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


@pytest.mark.parametrize("above", [10, 20])
def test_glare_along_half_of_an_edge_is_told(above):
    with pytest.raises(MissingFitting, match="shines on it") as caught:
        measure(covered(0.5, GLARE, above=above, below=-3), recipe())
    assert 0.2 < caught.value.figures["seen"] < 0.6


def test_a_finger_beside_the_muscles_end_is_told():
    u, v = sound().trace.upper
    rgb = photo().rgb.copy()
    centre = (int(u.min() - 0.2 * np.ptp(u)), int(v.mean()) + 20)
    cv2.ellipse(rgb, centre, (int(0.4 * np.ptp(u)), 30), 0, 0, 360, SKIN, -1)
    with pytest.raises((DamagedImage, MissingFitting)):
        measure(rgb, recipe())


@pytest.mark.parametrize("seed", [301, 302, 303])
def test_nothing_covers_a_tape_that_lies_open(seed):
    scene = random_scene(seed, px_per_in=(90.0, 130.0))
    camera = scene.camera
    how = Recipe(Scale.manual(camera.px_per_m), distance=camera.distance, centre=camera.centre)
    found = measure(photograph(scene, seed).rgb, how)
    assert found.quality.axis_kink < 0.6 * how.limits.axis_kink


def test_a_grey_tape_on_a_white_braid_is_not_taken_for_covered():
    grey = Tape(saturation=0.1, value=0.5)
    base = published_scene(0.2, size=(1060, 440))
    muscle = dataclasses.replace(base.muscle, upper=grey, lower=grey, albedo=(0.75, 0.75, 0.72))
    shot = photograph(dataclasses.replace(base, muscle=muscle), 4)
    found = measure(shot.rgb, Recipe(Scale.manual(shot.truth.px_per_m)))
    assert found.length == pytest.approx(shot.truth.length, abs=0.003 * INCH)


@pytest.mark.parametrize(("blur", "told"), [(0.7, 6.5), (1.2, 8.0)])
def test_motion_is_told_before_it_matters(blur, told):
    base = published_scene(0.15, size=(1060, 440))

    def moved(way):
        return photograph(dataclasses.replace(base, lens=Lens(blur_px=blur, motion_px=way)), 8)

    how = Recipe(Scale.manual(base.camera.px_per_m))
    still, slow = (measure(moved(way).rgb, how) for way in (0.0, 3.0))
    px = 1 / base.camera.px_per_m
    assert abs(slow.length - still.length) < 0.15 * px
    assert abs(slow.mean_diameter - still.mean_diameter) < 0.05 * px
    with pytest.raises(MotionBlurred):
        measure(moved(told).rgb, how)


def test_colour_tells_the_tape_whatever_the_light():
    """Six columns: tape lit and in the shade, gloss, another thing, braid, a black thing."""
    seen = np.stack([BLUE, 0.4 * BLUE, [220, 230, 250], [200, 150, 120], TAN, [30, 30, 30]])
    rgb = np.repeat(np.repeat(seen[None], 40, axis=0), 200, axis=1).clip(0, 255).astype(np.uint8)
    u, v = np.meshgrid(np.arange(1200.0), np.arange(10.0, 16.0), indexing="ij")
    shown = tape_shows(rgb, Tone.srgb(), (BLUE, TAN), u, v).reshape(6, 200)
    middle = shown[:, 60:140]
    assert np.array_equal(middle.all(axis=1), [True, True, False, False, False, False])
    assert not middle[2:].any()


def test_a_mid_line_may_bend_and_lean_but_not_jump():
    y = np.linspace(0, 1, 900)
    half = 60 + 40 * np.sin(np.pi * y)
    middle = 200 + 12 * y + 9 * np.sin(np.pi * y) + 0.03 * half * np.gradient(half)
    assert axis_kink(middle - half, middle + half) < 0.01
    assert axis_deviation(middle - half, middle + half) < 0.05
    bump = 10 * np.exp(-(((y - 0.3) / 0.02) ** 2))
    assert axis_kink(middle - half - bump, middle + half) == pytest.approx(5 / 85, rel=0.15)
