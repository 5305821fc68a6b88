"""Thresholds, boundaries, colours and the coarse outline, against other libraries and the truth."""

import cv2
import numpy as np
import pytest
from rendering import INCH, Tape, published_scene
from slow_cases import slow_after

from imaging import Recipe, Scale, measure, recipe
from imaging.segment import segment
from tests.imaging.photographs import changed, photograph

COARSE_PX = 8.0  # the fine steps find an edge that is up to 10 px away


@pytest.fixture(scope="module")
def photo():
    return photograph(published_scene(0.2625, size=(1060, 440)), 3)


def test_the_coarse_outline_is_near_the_true_one(photo):
    found = segment(photo.rgb)
    truth = photo.truth
    for mine, true in ((found.left, truth.left), (found.right, truth.right)):
        off = mine - np.interp(found.rows, truth.rows, true)
        assert np.abs(off).max() < COARSE_PX
    upper, lower = (edge[edge.shape[0] // 2, 1] for edge in (truth.upper_edge, truth.lower_edge))
    assert upper < found.rows[0] < upper + 4 * COARSE_PX
    assert lower - 4 * COARSE_PX < found.rows[-1] < lower


def test_a_large_picture_is_looked_at_twice_and_gives_the_same(photo):
    canvas = np.zeros((3200, 4000, 3), np.uint8)
    canvas[:] = np.median(photo.rgb[:40], axis=(0, 1))
    v, u = 900, 2100
    canvas[v : v + 1060, u : u + 440] = photo.rgb
    small, large = segment(photo.rgb), segment(canvas)
    columns = np.interp(small.rows, large.rows - v, large.left - u)
    assert np.abs(columns - small.left)[20:-20].max() < COARSE_PX
    limbs = [edge + v for edge in small.upper.limbs]
    assert large.upper.limbs == pytest.approx(limbs, abs=COARSE_PX)


BACKGROUNDS = {"black": None, "blue": (20, 30, 75), "tan": (85, 70, 45), "red": (80, 25, 20)}


@pytest.mark.parametrize("background", BACKGROUNDS)
@pytest.mark.parametrize("hue", slow_after(2, [222.0, 130.0, 355.0, 4.0]))
def test_a_tape_of_any_hue_on_cloth_of_any_colour(hue, background, monkeypatch):
    base = published_scene(0.12, size=(800, 332))
    shot = photograph(changed(base, {"upper": Tape(hue=hue), "lower": Tape(hue=hue)}), 6)
    rgb, colour = shot.rgb, BACKGROUNDS[background]
    if colour is not None:
        bright = (rgb.max(axis=2) > 60).astype(np.uint8)
        muscle = cv2.morphologyEx(bright, cv2.MORPH_CLOSE, np.ones((15, 15)))
        part = cv2.GaussianBlur(muscle.astype(np.float32), (0, 0), 1.0)[..., None]
        cloth = np.array(colour) + np.random.default_rng(0).normal(0, 4, rgb.shape)
        rgb = np.clip(rgb * part + (1 - part) * cloth, 0, 255).astype(np.uint8)

    # No lens drew the border to this cloth.
    checks = tuple(check for check in recipe._CHECKS if check[0] != "misfit")
    monkeypatch.setattr(recipe, "_CHECKS", checks)

    found = measure(rgb, Recipe(Scale.manual(shot.truth.px_per_m)))
    assert found.length == pytest.approx(shot.truth.length, abs=0.004 * INCH)
