"""The readings of a force map by pressure, and the actuation paths."""

import dataclasses

import numpy as np
from jaxtyping import Bool

from famjax.boundary.errors import InputError

from ..data import ForceData
from ..posing import path_end_at

_PRESSURES = 200  # of a map at most: 4 GB, which grow with the square of them


@dataclasses.dataclass(frozen=True)
class Readings:
    """Loaded readings by pressure, padded to one length, and the paths.

    Attributes:
        pressure: levels [Pa], increasing, shape (pressures,).
        force, length: [N, m], shape (pressures, readings).
        weight: 1/std, 1 without, 0 where there is no reading; shape (pressures, readings).
        path_end: shortest length [m] of each path, shape (pressures,).
    """

    pressure: np.ndarray
    force: np.ndarray
    length: np.ndarray
    weight: np.ndarray
    path_end: np.ndarray

    @property
    def there(self) -> Bool[np.ndarray, "pressures readings"]:
        """Which of the padded readings are readings."""
        return self.weight > 0


def arrange(data: ForceData, rest_length: float, order: int) -> Readings:
    """The readings of a force map by pressure, padded to one more than the order at least.

    The path at a pressure runs from rest to the longest length at which the muscle is slack there,
    or, where no reading is slack, to the shortest length.

    Raises:
        InputError: a pressure has no loaded reading that is shorter than the rest length, or there
            are more than 200 pressures.
    """
    loaded = data.loaded
    pressure = data.pressures.level
    levels = np.unique(pressure[loaded])
    if levels.size > _PRESSURES:
        raise InputError(
            f"a sweep follows the path of each pressure, and takes {_PRESSURES} pressures at most; "
            f"the map has {levels.size}. Interpolate the readings to some pressures, or say which of "
            "them are one, by a line of the file such as `# level: pressure_tolerance_kPa = 5`; one "
            "law is fitted to all of the readings by `famjax fit` and `fitting.identify`"
        )
    at = [np.flatnonzero(loaded & (pressure == level)) for level in levels]
    size = max(order + 1, *(indices.size for indices in at))
    padded = np.stack([np.pad(indices, (0, size - indices.size), mode="edge") for indices in at])
    there = np.arange(size) < np.array([indices.size for indices in at])[:, None]
    std = np.ones_like(data.force) if data.force_std is None else data.force_std
    ends = np.array([path_end_at(data, float(level)) for level in levels])
    short = np.flatnonzero(ends >= rest_length)
    if short.size:
        raise InputError(
            f"at {levels[short[0]] / 1e3:.5g} kPa no reading is shorter than the rest length of "
            f"{rest_length * 1e3:.5g} mm, so that no actuation path begins there: leave that "
            "pressure out"
        )
    return Readings(
        pressure=levels,
        force=data.force[padded],
        length=data.length[padded],
        weight=np.where(there, 1 / std[padded], 0.0),
        path_end=ends,
    )
