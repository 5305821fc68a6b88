"""A stroke: photographs at a camera's times, and the record that a test machine makes beside them."""

import dataclasses
import datetime
from collections.abc import Callable, Iterator
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike

from famjax.boundary.units import factor
from imaging.camera import Array

from .exposure import Photo
from .muscle import Profile, stroke_shape
from .renderer import render
from .scene import Scene

Contraction = Callable[[Array], ArrayLike]
START = datetime.datetime(2021, 3, 1, 10, 0, 0)


def triangle_stroke(peak: float, period_s: float) -> Contraction:
    """A contraction that goes from 0 to `peak` [-] and back at one speed within `period_s` [s]."""

    def contraction(time: Array) -> Array:
        return peak * (1 - np.abs(np.asarray(time, float) % period_s * 2 / period_s - 1))

    return contraction


def at_length(scene: Scene, length: float, profile: Profile, time: datetime.datetime) -> Scene:
    """The scene at another length and time, the muscle's upper end where it was."""
    muscle = scene.muscle
    assert muscle is not None
    y0 = muscle.y0 - (muscle.length - length) / 2
    now = dataclasses.replace(muscle, profile=profile, length=length, y0=y0)
    return dataclasses.replace(scene, muscle=now, time=time)


def render_sequence(
    scene: Scene,
    contraction: Contraction,
    times: ArrayLike,
    *,
    clock_offset: float = 0.0,
    seed: int,
) -> Iterator[Photo]:
    """Photographs of a stroke, one after the other, each with the truth of its own instant.

    The upper end stays where it is in `scene`, whose muscle is the one at rest; the profile is
    `stroke_shape` at the contraction of the instant. The camera's clock shows `clock_offset` [s]
    after `START` at the machine's time 0.
    """
    muscle = scene.muscle
    assert muscle is not None
    times = np.asarray(times, float)
    shortened = np.asarray(contraction(times), float)
    for k, (time, c) in enumerate(zip(times, shortened, strict=True)):
        shape = stroke_shape(float(c), float(muscle.diameter(0.0)))
        stamp = START + datetime.timedelta(seconds=clock_offset + float(time))
        yield render(at_length(scene, muscle.length * (1 - float(c)), shape, stamp), seed + 1 + k)


@dataclasses.dataclass(frozen=True)
class StrokeLog:
    """What a test machine records of a stroke, SI, all of shape (n,)."""

    time: Array
    displacement: Array
    force: Array
    pressure: Array

    def save(self, path: str | PathLike[str]) -> None:
        """Write time_s, displacement_in, force_lbf, pressure_psi as CSV."""
        columns = {
            "time_s": self.time,
            "displacement_in": self.displacement / factor("in", "length"),
            "force_lbf": self.force / factor("lbf", "force"),
            "pressure_psi": self.pressure / factor("psi", "pressure"),
        }
        table = np.column_stack(list(columns.values()))
        np.savetxt(path, table, "%.7g", delimiter=",", header=",".join(columns), comments="")


def stroke_log(contraction: Contraction, times: ArrayLike, rest_length: float) -> StrokeLog:
    """The record for the same stroke at 100 psi.

    The force falls linearly between the reference work's two ends: no muscle's law, but its range.
    """
    times = np.asarray(times, float)
    c = np.asarray(contraction(times), float)
    force = 1058 * factor("lbf", "force") * (1 - c / 0.354)
    pressure = np.full(times.shape, 100 * factor("psi", "pressure"))
    return StrokeLog(times, c * rest_length, force, pressure)
