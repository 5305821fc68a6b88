"""The faces of a posterior: what of a constraint is active at the optimum, or near it."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ..engine import Point
from ..problem import Problem

_PARALLEL = 0.01  # sine of the angle between two faces below which they are one
_NEAR = 3.0  # standard deviations of a slack within which a constraint cuts off draws


@dataclasses.dataclass(frozen=True)
class Faces:
    """Rows of the constraint that the posterior's coordinates follow.

    Attributes:
        rows: among those of the problem, faces first, then bounds of held coefficients.
        slacks: places of the faces among the rows of `at_faces`.
        held: places there of the lower bounds of held coefficients, whose slack is zero.
        stations: of each part, positions of the faces on its paths, shape (paths, most).
    """

    rows: Int[np.ndarray, " r"]
    slacks: tuple[int, ...]
    held: tuple[int, ...]
    stations: tuple[Float[np.ndarray, "paths most"], ...]


def faces_of(
    problem: Problem,
    point: Point,
    scale: Float[np.ndarray, "n n"],
    spread: Float[np.ndarray, " m"],
) -> Faces:
    """The rows that cut off draws and differ in direction: the active ones, then the nearest.

    Args:
        problem: of the fit.
        point: its optimum.
        scale: of coefficients that are about a standard normal.
        spread: standard deviations of the slacks of all rows.
    """
    G, n = point.G @ scale, len(problem.linear)
    slack = point.G @ point.x - point.h
    size = np.linalg.norm(G, axis=1)
    # The last rows are the bounds on coefficients, lower ones first.
    n_path = len(G) - 2 * n
    held = n_path + np.flatnonzero(problem.coefficient_min == problem.coefficient_max)
    above = held + n
    both = {*held.tolist(), *above.tolist()}
    directions = [G[row] / size[row] for row in held]
    chosen = []
    push = point.multipliers * size[point.rows]
    away = np.where(spread > 0, slack / np.where(spread > 0, spread, 1.0), np.inf)
    nearest = np.argsort(away, kind="stable")
    order = [*point.rows[np.argsort(-push, kind="stable")].tolist(),
             *nearest[away[nearest] < _NEAR].tolist()]  # fmt: skip
    for row in order:
        if row in both or not size[row] > 0 or len(directions) == len(scale):
            continue
        known = np.linalg.qr(np.array(directions).reshape(-1, len(scale)).T)[0]
        direction = G[row] / size[row]
        if np.linalg.norm(direction - known @ (known.T @ direction)) > _PARALLEL:
            chosen.append(row)
            directions.append(direction)
    return _placed(problem, np.array(sorted(chosen), int), held, n_path)


def at_faces(problem: Problem, faces: Faces) -> Problem:
    """The problem with its constraint posed at the faces only."""
    parts = tuple(
        dataclasses.replace(part, inputs=dataclasses.replace(part.inputs, stations=stations))
        for part, stations in zip(problem.parts, faces.stations, strict=True)
    )
    return dataclasses.replace(problem, parts=parts)


def _placed(
    problem: Problem, rows: Int[np.ndarray, " r"], held: Int[np.ndarray, " e"], n_path: int
) -> Faces:
    """The rows as those of a problem whose constraint is posed at them only."""
    places, stations, first, first_new = [], [], 0, 0
    along = problem.constraint in {"slope", "drucker"}
    for part in problem.parts:
        paths, count = part.inputs.stations.shape
        count = count if along else 0
        here = rows[(rows >= first) & (rows < min(first + paths * count, n_path))] - first
        path, station = np.divmod(here, max(count, 1))
        of_path = np.bincount(path, minlength=paths)
        most = int(of_path.max(initial=0))
        posed, used = np.zeros((paths, most)), np.zeros(paths, int)
        for k, s in zip(path.tolist(), station.tolist(), strict=True):
            posed[k, used[k]] = part.inputs.stations[k, s]
            places.append(first_new + k * most + int(used[k]))
            used[k] += 1
        stations.append(posed)
        first, first_new = first + paths * count, first_new + paths * most
    bounds = rows[rows >= n_path]
    places += (first_new + bounds - n_path).tolist()
    at_bounds = tuple((first_new + held - n_path).tolist())
    return Faces(np.concatenate([rows, held]), tuple(places), at_bounds, tuple(stations))
