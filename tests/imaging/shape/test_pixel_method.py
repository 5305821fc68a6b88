"""The reference work's method: its equations, its tracer, its accuracy."""

import colorsys

import cv2
import numpy as np
import pytest

from imaging import Recipe, Scale, measure
from imaging.synthetic import INCH, published_scene
from tests.imaging.photographs import photograph

# Clockwise from the east, as (du, dv), v downwards.
AROUND = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
PIXEL_LEVEL_IN = 0.04  # the work states 0.024 in of length at its best


def moore_trace(mask):
    """Boundary by Moore's neighbours with Jacob's stop: start again, entered from the same side."""
    padded = np.pad(mask, 1)
    v, u = np.argwhere(padded)[0]
    start, came = (u, v), 4  # the first pixel in reading order is entered from its west
    here, direction, path = start, came, []
    first_entry = None
    while True:
        path.append((here[0] - 1, here[1] - 1))
        for turn in range(1, 9):
            k = (direction + turn) % 8
            there = here[0] + AROUND[k][0], here[1] + AROUND[k][1]
            if padded[there[1], there[0]]:
                break
        else:
            return path
        before = AROUND[(k - 1) % 8]
        back = here[0] + before[0] - there[0], here[1] + before[1] - there[1]
        here, direction = there, AROUND.index(back)
        if first_entry is None:
            first_entry = (here, direction)
        elif (here, direction) == first_entry:
            return path[:-1]


def same_cycle(a, b):
    if len(a) != len(b):
        return False
    for way in (b, b[::-1]):
        joined = way + way
        if any(joined[k : k + len(a)] == a for k in range(len(b))):
            return True
    return False


def test_opencvs_hsv_is_that_of_the_reference_works_equations():
    random = np.random.default_rng(0)
    rgb = random.integers(0, 256, (200, 1, 3), np.uint8)
    rgb[:8, 0] = [[0, 0, 0], [9, 9, 9], [255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255],
                  [255, 0, 1], [200, 200, 10]]  # fmt: skip
    opencv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV_FULL)[:, 0].astype(float)
    library = np.array([colorsys.rgb_to_hsv(*(pixel / 255)) for pixel in rgb[:, 0]])
    turn = (opencv[:, 0] - 256 * library[:, 0] + 128) % 256 - 128
    assert np.abs(turn).max() <= 1
    np.testing.assert_allclose(opencv[:, 1:], 255 * library[:, 1:], atol=1)


@pytest.mark.parametrize("seed", range(20))
def test_contours_are_moores_trace(seed):
    random = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(random.normal(size=(40, 50)), (0, 0), random.uniform(1.0, 3.5))
    mask = (noise > np.quantile(noise, random.uniform(0.5, 0.8))).astype(np.uint8)
    count, labels = cv2.connectedComponents(mask)
    for i in range(1, min(count, 5)):
        blob = (labels == i).astype(np.uint8)
        if np.count_nonzero(blob) < 2:
            continue
        contours, _ = cv2.findContours(blob, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        (contour,) = contours
        theirs = [tuple(int(x) for x in point) for point in contour.reshape(-1, 2)]
        ours = [(int(u), int(v)) for u, v in moore_trace(blob.astype(bool))]
        assert same_cycle(ours, theirs)


@pytest.fixture(scope="module")
def scene():
    return published_scene(0.175, size=(1325, 550))


def test_it_measures_at_pixel_level(scene):
    photo = photograph(scene, 1)
    found = measure(photo.rgb, Recipe(Scale.manual(scene.camera.px_per_m), method="pixel"))
    truth = photo.truth
    px = 1 / scene.camera.px_per_m
    true = np.interp(found.z / found.length, truth.z / truth.length, truth.diameter)
    assert abs(np.mean(found.diameter - true)) < 2.0 * px
    assert abs(found.length - truth.length) < PIXEL_LEVEL_IN * INCH * 2  # at half the resolution
    assert found.method == "pixel"
    assert np.all(np.isin((found.diameter / px).round(6) % 1, [0.0, 1.0]))
    assert np.isnan(found.quality.blur_px)
    assert found.quality.eta_hue > 0.9


def test_the_sub_pixel_method_is_better(scene):
    photo = photograph(scene, 2)
    truth = photo.truth
    errors = {}
    for method in ("pixel", "limb"):
        recipe = Recipe(Scale.manual(scene.camera.px_per_m), method=method)
        found = measure(photo.rgb, recipe)
        true = np.interp(found.z / found.length, truth.z / truth.length, truth.diameter)
        errors[method] = (
            np.sqrt(np.mean((found.diameter - true) ** 2)), abs(found.length - truth.length)
        )  # fmt: skip
    assert errors["limb"][0] < 0.5 * errors["pixel"][0]
    assert errors["limb"][1] < 0.3 * errors["pixel"][1]
