"""Validation of a choice: made anew without each pressure and each length, which it then predicts."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..data.force_data import ForceData
from .choose import Choice, choose

_STARTS = 4
_MOST = 20  # folds


@dataclasses.dataclass(frozen=True)
class NestedValidation:
    """Errors of a choice on what neither the fits nor the choice had seen.

    Attributes:
        groups: what was left out together, one "pressure" or one "length".
        values: the levels left out one after another [Pa or m]; means of neighbouring ones, where
            there are more than twenty.
        error: prediction less reading [N] at the loaded readings, each while it was left out.
        inside: whether the reading lies within the 95 % band of its prediction.
        width: full width [N] of that band.
        names: of the family that was chosen without each.
        group: number of each reading's level.
    """

    groups: str
    values: Float[np.ndarray, " groups"]
    error: Float[np.ndarray, " points"]
    inside: Bool[np.ndarray, " points"]
    width: Float[np.ndarray, " points"]
    names: tuple[str, ...]
    group: np.ndarray

    @property
    def rmse(self) -> float:
        """Over all readings [N]."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def group_rmse(self) -> Float[np.ndarray, " groups"]:
        """On each level while it was left out [N]."""
        return np.sqrt(np.bincount(self.group, self.error**2) / np.bincount(self.group))

    @property
    def interior_rmse(self) -> float:
        """Over all levels but the lowest and the highest [N]; nan with fewer than three."""
        inner = (self.group > 0) & (self.group < self.group.max())
        return float(np.sqrt(np.mean(self.error[inner] ** 2))) if inner.any() else np.nan

    @property
    def covered(self) -> float:
        """Part of the readings inside their 95 % bands."""
        return float(np.mean(self.inside))


def validate_choice(
    choice: Choice,
    groups: str = "length",
    *,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> NestedValidation:
    """The errors of a choice on pressures or lengths that neither it nor its fits have seen.

    Args:
        choice: from `choose`.
        groups: "pressure" or "length".
        progress: called with (levels done, levels).
        options: as `choose` was given; a fold has four starts at the most.
    """
    options["starts"] = min(options.get("starts", _STARTS), _STARTS)
    data = choice.data
    levels = {"pressure": data.pressures, "length": data.lengths}[groups].level
    loaded = levels[data.loaded]
    single, place = np.unique(loaded, return_inverse=True)
    count = min(single.size, _MOST)
    group = place * count // single.size
    values = np.bincount(group, loaded) / np.bincount(group)
    error, inside, width = np.zeros(loaded.size), np.zeros(loaded.size, bool), np.zeros(loaded.size)
    names = []
    for k in range(count):
        mine = group == k
        rest = choose(without(data, np.isin(levels, loaded[mine])), **options)
        names.append(rest.names[0])
        at = data.length[data.loaded][mine], data.pressure[data.loaded][mine]
        error[mine] = rest.predict(*at) - data.force[data.loaded][mine]
        half = rest.error.factor() * rest.error.std(*at)
        inside[mine], width[mine] = np.abs(error[mine]) <= half, 2 * half
        if progress is not None:
            progress(k + 1, values.size)
    return NestedValidation(groups, values, error, inside, width, tuple(names), group)


def without(data: ForceData, out: Bool[np.ndarray, " n"]) -> ForceData:
    """The map without some of its readings."""
    columns = ("force", "pressure", "length", "force_std", "pressure_std", "length_std")
    kept = {name: values[~out] for name in columns if (values := getattr(data, name)) is not None}
    return dataclasses.replace(
        data, **kept, pressure_tolerance=data.pressures.tolerance,
        length_tolerance=data.lengths.tolerance,
    )  # fmt: skip
