"""The record that a test machine makes of a stroke, beside rendered photographs."""

import dataclasses
from collections.abc import Callable
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from famjax.boundary.units import factor

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class StrokeLog:
    """What a test machine records of a stroke, SI, all of shape (n,).

    Attributes:
        time: the machine's clock, from its start [s].
        displacement: of the crosshead, positive when the muscle is shorter [m].
        force: pull of the muscle [N].
        pressure: gauge pressure [Pa].
    """

    time: Array
    displacement: Array
    force: Array
    pressure: Array

    def save(self, path: str | PathLike[str]) -> Path:
        """Write time_s, displacement_in, force_lbf, pressure_psi as CSV; returns the path."""
        columns = {
            "time_s": self.time,
            "displacement_in": self.displacement / factor("in", "length"),
            "force_lbf": self.force / factor("lbf", "force"),
            "pressure_psi": self.pressure / factor("psi", "pressure"),
        }
        table = np.column_stack(list(columns.values()))
        np.savetxt(path, table, "%.7g", delimiter=",", header=",".join(columns), comments="")
        return Path(path)


def stroke_log(
    contraction: Callable[[Array], ArrayLike],
    times: ArrayLike,
    rest_length: float,
    *,
    pressure: float = 100 * factor("psi", "pressure"),
    blocked_force: float = 1058 * factor("lbf", "force"),
    free_contraction: float = 0.354,
    displacement_noise: float = 0.0,
    seed: int = 0,
) -> StrokeLog:
    """The record of a test machine for the same stroke; a force that falls linearly will do here.

    F = F_b (1 - c / c_f): no muscle's law, but it has a muscle's range.

    Args:
        contraction: as in `render_sequence`.
        times: of the record [s], shape (n,).
        rest_length: L0 [m].
        pressure: gauge pressure P [Pa], held.
        blocked_force: F_b [N].
        free_contraction: c_f [-].
        displacement_noise: standard deviation [m].
        seed: of the noise.

    References:
        Chambers 2021, tables 6.11 and 6.12, for the two ends of the force at 100 psi.
    """
    times = np.asarray(times, float)
    c = np.asarray(contraction(times), float)
    noise = displacement_noise * np.random.default_rng(seed).standard_normal(times.shape)
    force = blocked_force * (1 - c / free_contraction)
    return StrokeLog(times, c * rest_length + noise, force, np.full(times.shape, pressure))
