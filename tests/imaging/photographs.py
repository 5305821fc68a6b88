"""Photographs of rendered scenes, the rays of each followed once, and lines drawn on them found again."""

import dataclasses
import functools

import numpy as np
from rendering import CameraSensor, Lens, LinearPhoto, Photo, Scene, expose, render_linear
from rendering.exposure import through_lens

OPEN = Lens(blur_px=0.0)


@functools.lru_cache(maxsize=12)
def _unblurred(scene: Scene) -> LinearPhoto:
    return render_linear(scene)


def photograph(scene: Scene, seed: int) -> Photo:
    """As `rendering.render`, to the last bit."""
    bare = dataclasses.replace(
        scene, lens=OPEN, sensor=CameraSensor(), jpeg=None, time=None, lying=False
    )
    taken = _unblurred(bare)
    light = through_lens(taken.light, scene.lens)
    return expose(dataclasses.replace(taken, scene=scene, light=light), seed)


def marked(image, colour):
    """v and u of the pixels of a colour, a third as bright or more: lines fade at their sides."""
    pixels, wanted = image.astype(float), np.array(colour, float)
    bright = np.linalg.norm(pixels, axis=2)
    like = pixels @ wanted / np.maximum(bright, 1) / np.linalg.norm(wanted)
    return np.nonzero((like > 0.998) & (bright > np.linalg.norm(wanted) / 3))
