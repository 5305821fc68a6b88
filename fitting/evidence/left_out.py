"""Errors on readings while they were left out: what a model is judged by, and its bands are made of."""

import dataclasses
from collections.abc import Sequence

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
    def of_mean(several: Sequence["LeftOut"]) -> "LeftOut":
        """Errors of the mean of several predictions of the same."""
        error = np.mean([one.error for one in several], axis=0)
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


def levels_of_groups(
    level: Float[np.ndarray, " points"], group: Int[np.ndarray, " points"]
) -> Float[np.ndarray, " groups"]:
    """The level of each group; the mean over its readings where it has several."""
    first = level[np.unique(group, return_index=True)[1]]
    return first + np.bincount(group, level - first[group]) / np.bincount(group)
