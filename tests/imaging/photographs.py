"""Photographs of rendered scenes, with the rays of a scene followed once for all its lenses and sensors."""

import dataclasses
import functools

from imaging.synthetic import Lens, LinearPhoto, Photo, Scene, Sensor, expose, render_linear
from imaging.synthetic.exposure import through_lens

OPEN = Lens(blur_px=0.0)


@functools.lru_cache(maxsize=12)
def _unblurred(scene: Scene) -> LinearPhoto:
    return render_linear(scene)


def photograph(scene: Scene, seed: int) -> Photo:
    """As `imaging.synthetic.render`, to the last bit."""
    bare = dataclasses.replace(scene, lens=OPEN, sensor=Sensor(), jpeg=None, time=None, lying=False)
    taken = _unblurred(bare)
    light = through_lens(taken.light, scene.lens)
    return expose(dataclasses.replace(taken, scene=scene, light=light), seed)
