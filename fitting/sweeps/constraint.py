"""Constraints on the coefficients along paths: their rows, and where a law comes nearest to one."""

import dataclasses

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from .arrays import AnyArray, namespace, of_each
from .paths import PathFunctions, PathTable

MATTERS = 1e-4
"""Slack per largest coefficient above which a dip stays inactive by the last steps."""

PER_PATH = 2
"""Dips that are looked at on each path."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Dips:
    """The weakest local minima of the constraint on the paths of each fit, weakest first.

    Those at stations come last: the rows there are posed already.

    Attributes:
        path: index among the paths of the fit, shape (b, k).
        s: position in [0, 1], shape (b, k).
        slack: there, per largest coefficient; infinite where there is none, shape (b, k).
        moves: whether it may be moved along the path, shape (b, k).
        station: whether the constraint is posed there from the start, shape (b, k).
    """

    path: Int[AnyArray, "b k"]
    s: Float[AnyArray, "b k"]
    slack: Float[AnyArray, "b k"]
    moves: Bool[AnyArray, "b k"]
    station: Bool[AnyArray, "b k"]

    @classmethod
    def none(cls, s: Float[AnyArray, "b k"]) -> "Dips":
        """Places without a dip, for a search to start with."""
        off = namespace(s).zeros(s.shape, bool)
        return cls(off * 1, s, s + np.inf, off, off)

    @property
    def matters(self) -> Bool[AnyArray, "b k"]:
        """Whether it may be a place where the constraint is active between the stations."""
        return (self.slack < MATTERS) & ~self.station


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Constraint:
    """What must not be negative along the paths of each fit, as rows on its unknowns y.

    Attributes:
        on_y: coefficients of each path per unknown, E = on_y y, shape (b, paths, order, n).
        posed: rows that hold from the start, of unit length or zero, shape (b, m, n).
        stations: where they are, shape (b, paths, stations); None where these rows are all there is.
        path: indices of the paths among those of the functions, shape (b, paths).
        table: of the functions, shape (b, paths, nodes).
        functions: of all paths.
    """

    on_y: Float[AnyArray, "b paths order n"]
    posed: Float[AnyArray, "b m n"]
    stations: Float[AnyArray, "b paths stations"] | None = None
    path: Int[AnyArray, "b paths"] | None = None
    table: PathTable | None = None
    functions: PathFunctions | None = None

    @classmethod
    def positive(
        cls,
        on_y: Float[AnyArray, "b paths order n"],
        on: Bool[AnyArray, " b"],
    ) -> "Constraint":
        """E_n >= 0 at the first and at the last path, and so between them; or nothing where off."""
        ends = on_y[:, np.array([0, on_y.shape[1] - 1])] * of_each(on * 1.0, 3)
        return cls(on_y, unit(ends.reshape(len(on_y), -1, on_y.shape[-1])))

    @classmethod
    def along(
        cls,
        on_y: Float[AnyArray, "b paths order n"],
        path: Int[AnyArray, "b paths"],
        functions: PathFunctions,
        table: PathTable,
        stations: Int[np.ndarray, " stations"],
    ) -> "Constraint":
        """sum_n E_n phi_n >= 0 everywhere on the paths of those indices.

        Args:
            on_y: coefficients of each path per unknown.
            path: index of each among the paths of the functions.
            functions: of all paths.
            table: of the functions.
            stations: indices of its nodes at which the constraint is posed from the start.
        """
        own, path = jax.tree.map(lambda leaf: leaf[path], table), namespace(on_y).asarray(path)
        rows = (own.value[:, :, stations] @ on_y).reshape(len(on_y), -1, on_y.shape[-1])
        return cls(on_y, unit(rows), own.nodes[:, :, stations], path, own, functions)

    def coefficients(self, y: Float[AnyArray, "b n"]) -> Float[AnyArray, "b paths order"]:
        """E_n at the paths."""
        return (self.on_y @ y[:, None, :, None])[..., 0]

    def dips(self, y: Float[AnyArray, "b n"]) -> Dips:
        """Where the constraint is weakest: of each path the weakest local minima."""
        assert self.table is not None
        assert self.stations is not None
        xp, E = namespace(y), self.coefficients(y)
        least, s, inside = self.table.minima(E)
        beside = xp.pad(least, ((0, 0), (0, 0), (1, 1)), constant_values=np.inf)
        local = (least < beside[..., :-2]) & (least <= beside[..., 2:])
        depth, found = xp.where(local, least, np.inf), []
        for _ in range(PER_PATH):
            lowest = depth.min(axis=2)
            there = (depth == lowest[..., None]) & (depth < np.inf)
            at = xp.where(there, s, 1.0).min(axis=2)
            here = there & (s == at[..., None])
            found.append((lowest, at, (here & inside).any(axis=2)))
            depth = xp.where(here, np.inf, depth)
        slack, s, inside = (xp.concatenate(each, axis=1) for each in zip(*found, strict=True))
        largest = abs(E).max(axis=(1, 2))
        there = of_each(largest > 0) & (slack < np.inf)
        slack = xp.where(there, slack / of_each(xp.where(largest > 0, largest, 1.0)), np.inf)
        path = np.tile(np.arange(E.shape[1]), PER_PATH)
        station = (self.stations[:, path] == s[..., None]).any(axis=2)
        every, path = np.arange(len(E))[:, None], path + xp.zeros(s.shape, int)
        dips = Dips(path, s, slack, inside, station)
        order = xp.argsort(xp.where(station, np.inf, slack), axis=1)
        return jax.tree.map(lambda leaf: leaf[every, order], dips)

    def rows(
        self, path: Int[AnyArray, "b k"], s: Float[AnyArray, "b k"], derivatives: int = 0
    ) -> tuple[Float[AnyArray, "b k n"], ...]:
        """Rows on y at positions of paths, not scaled, and their derivatives in s."""
        assert self.functions is not None
        assert self.path is not None
        own = np.arange(len(path))[:, None]
        phi = self.functions.rows(self.path[own, path], s, derivatives)
        on_y = self.on_y[own, path]
        return tuple((one[..., None, :] @ on_y)[..., 0, :] for one in phi)


def length(rows: Float[AnyArray, "*batch n"]) -> Float[AnyArray, "*batch"]:
    """Lengths of rows, zero for empty ones, with a derivative everywhere."""
    xp, square = namespace(rows), (rows**2).sum(axis=-1)
    empty = square == 0
    return xp.where(empty, 0.0, xp.sqrt(xp.where(empty, 1.0, square)))


def unit(rows: Float[AnyArray, "*batch n"]) -> Float[AnyArray, "*batch n"]:
    """Rows of unit length, or empty."""
    size = length(rows)
    return rows / namespace(rows).where(size > 0, size, 1.0)[..., None]
