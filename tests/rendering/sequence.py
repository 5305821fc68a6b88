"""A stroke: photographs at a camera's times, and the record that a test machine makes beside them."""

import dataclasses
import datetime
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from famjax.units import LBF, PSI
from fitting.records import MachineLog
from imaging.camera import Array

from .exposure import Photo
from .muscle import Profile, stroke_shape
from .renderer import render
from .scene import Scene

Contraction = Callable[[Array], Array]
START = datetime.datetime(2021, 3, 1, 10, 0, 0)


def triangle_stroke(peak: float, period_s: float) -> Contraction:
    """A contraction that goes from 0 to `peak` and back at one speed within `period_s`."""
    return lambda time: peak * (1 - np.abs(np.asarray(time) % period_s * 2 / period_s - 1))


def at_length(scene: Scene, length: float, profile: Profile, time: datetime.datetime) -> Scene:
    """The scene at another length and time, the muscle's upper end where it was."""
    muscle = scene.muscle
    assert muscle is not None
    y0 = muscle.y0 - (muscle.length - length) / 2
    now = dataclasses.replace(muscle, profile=profile, length=length, y0=y0)
    return dataclasses.replace(scene, muscle=now, time=time)


def render_sequence(
    rest: Scene, contraction: Contraction, times: ArrayLike, *, clock_offset: float, seed: int
) -> Iterator[Photo]:
    """Photographs of a stroke; the camera's clock is `clock_offset` [s] after `START` at time 0."""
    muscle = rest.muscle
    assert muscle is not None
    times = np.asarray(times, float)
    for k, (time, c) in enumerate(zip(times.tolist(), contraction(times).tolist(), strict=True)):
        shape = stroke_shape(c, float(muscle.diameter(0.0)))
        stamp = START + datetime.timedelta(seconds=clock_offset + time)
        yield render(at_length(rest, muscle.length * (1 - c), shape, stamp), seed + 1 + k)


def stroke_log(contraction: Contraction, times: ArrayLike, rest_length: float) -> MachineLog:
    """The record at 100 psi; the force falls linearly between the reference work's two ends."""
    times = np.asarray(times, float)
    c = contraction(times)
    force, pressure = 1058 * LBF * (1 - c / 0.354), np.full(times.shape, 100 * PSI)
    return MachineLog(times, c * rest_length, force, pressure)
