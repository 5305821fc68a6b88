"""A stroke: photographs at a camera's times; `stroke_log` is the machine's record of it."""

import dataclasses
import datetime
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from imaging.camera import Array

from .exposure import Photo
from .muscle import stroke_shape
from .renderer import render
from .scene import Scene
from .truth import MuscleTruth

Contraction = Callable[[Array], ArrayLike]
START = datetime.datetime(2021, 3, 1, 10, 0, 0)


def triangle_stroke(peak: float, period_s: float) -> Contraction:
    """A contraction that goes from 0 to `peak` [-] and back at one speed within `period_s` [s]."""

    def contraction(time: Array) -> Array:
        return peak * (1 - np.abs(np.asarray(time, float) % period_s * 2 / period_s - 1))

    return contraction


def render_sequence(
    scene: Scene,
    contraction: Contraction,
    times: ArrayLike,
    *,
    jitter: float = 0.0,
    clock_offset: float = 0.0,
    clock_rate: float = 1.0,
    start: datetime.datetime = START,
    seed: int = 0,
) -> Iterator[Photo[MuscleTruth]]:
    """Photographs of a stroke, one after the other, each with the truth of its own instant.

    The upper end stays where it is in `scene`, whose muscle is the one at rest; the profile is
    `stroke_shape` at the contraction of the instant.

    Args:
        scene: the scene at contraction 0.
        contraction: of the machine's time [s], shape (n,) to (n,), within 0 to 0.35.
        times: when the camera is released, by the machine's clock [s], shape (n,).
        jitter: standard deviation of the shutter's delay against the stamp [s].
        clock_offset: what the camera's clock shows at the machine's time 0, counted from `start` [s].
        clock_rate: seconds of the camera's clock in one of the machine's [-].
        start: date and time from which the stamps count.
        seed: of the jitter, and with the picture's number of its noise.

    Raises:
        ValueError: a scene without a muscle.
    """
    muscle = scene.muscle
    if muscle is None:
        raise ValueError("a stroke needs a scene with a muscle, got one of the cloth alone")
    times = np.asarray(times, float)
    taken = times + jitter * np.random.default_rng(seed).standard_normal(times.shape)
    shortened = np.asarray(contraction(taken), float)
    for k, (time, c) in enumerate(zip(times, shortened, strict=True)):
        length = muscle.length * (1 - float(c))
        now = dataclasses.replace(
            muscle,
            profile=stroke_shape(float(c), float(muscle.diameter(0.0))),
            length=length,
            y0=muscle.y0 - (muscle.length - length) / 2,
        )
        stamp = start + datetime.timedelta(seconds=clock_offset + clock_rate * float(time))
        picture = dataclasses.replace(scene, muscle=now, time=stamp)
        yield render(picture, seed + 1 + k)
