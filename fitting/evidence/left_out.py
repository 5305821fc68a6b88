"""Errors on readings while they were left out: what a model is judged by, and its bands are made of."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """Errors of predictions of readings that the fit had not seen.

    Attributes:
        groups: what was left out together, readings of one "pressure", "length" or "specimen".
        level: of each reading [Pa or m], or the number of its specimen, shape (points,).
        group: number of each reading's group, shape (points,).
        error: prediction less reading [N] while its group was left out, shape (points,).
    """

    groups: str
    level: Float[np.ndarray, " points"]
    group: Int[np.ndarray, " points"]
    error: Float[np.ndarray, " points"]

    @staticmethod
    def of_mean(several: Sequence["LeftOut"], weights: Sequence[float]) -> "LeftOut":
        """Errors of the weighted mean of several predictions of the same."""
        error = np.average([one.error for one in several], axis=0, weights=weights)
        return dataclasses.replace(several[0], error=error)

    @property
    def values(self) -> Float[np.ndarray, " groups"]:
        """What was left out one after another, see `level`; means where a group has several."""
        return levels_of_groups(self.level, self.group)

    @property
    def group_rmse(self) -> Float[np.ndarray, " groups"]:
        """Root mean square error [N] of each group while it was left out."""
        return np.sqrt(np.bincount(self.group, self.error**2) / np.bincount(self.group))

    @property
    def rmse(self) -> float:
        """Over all readings [N]."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def interior_rmse(self) -> float:
        """Over all groups but the lowest and the highest [N], which are extrapolations; nan if none."""
        inner = (self.group > 0) & (self.group < self.group.max())
        return float(np.sqrt(np.mean(self.error[inner] ** 2))) if inner.any() else np.nan


def columns_of(left_out: Mapping[str, LeftOut]) -> dict[str, float]:
    """RMSE [N] on pressures, interior lengths, end lengths or specimens left out; groups weigh alike.

    The shortest and the longest length, left out, are extrapolated to.
    """
    found = {}
    for kind, one in left_out.items():
        groups = one.group_rmse
        if kind == "length":
            found["interior length"] = _root_mean_square(groups[1:-1])
            found["end length"] = _root_mean_square(groups[[0, -1]])
        else:
            found[kind] = _root_mean_square(groups)
    return {name: error for name, error in found.items() if np.isfinite(error)}


def _root_mean_square(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else np.nan


def levels_of_groups(
    level: Float[np.ndarray, " points"], group: Int[np.ndarray, " points"]
) -> Float[np.ndarray, " groups"]:
    """The level of each group; the mean over its readings where it has several."""
    first = level[np.unique(group, return_index=True)[1]]
    return first + np.bincount(group, level - first[group]) / np.bincount(group)
