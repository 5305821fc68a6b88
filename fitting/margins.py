"""Stability margins at an optimum, between the stations too, and constraints that hold there.

Where along a path a law is weakest is found by samples of the path that close in on each of their minima.
A constraint that is violated between its stations is posed there as well, until it is not (exchange).

References:
    Hettich & Kortanek 1993, SIAM Review 35, 380-429 (exchange).
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .engine import Point, report_of, solve
from .problem import Part, Problem
from .response import Constraint
from .search import End, descend

FEASIBLE = 1e-9
"""Violation of a constraint that counts as rounding, in parts of the largest coefficient."""
_VANISHED = 1e-3  # of the coefficient that alone would carry the force
_ROUNDS = 64  # of exchange, at most
_PIECES = 4  # of each path, each with as many samples as a path has stations
_MINIMA = 3  # of the samples of a path that are closed in on
_ZOOMS = 5  # each narrows a minimum to two of the cells between its samples


class Margin(NamedTuple):
    """The weakest state on each path of a part.

    Attributes:
        position: share of the path in [0, 1], shape (paths,).
        value: modulus there [Pa], shape (paths,); nan where the law has none.
        bound: by how much the true minimum may lie lower, in parts of the largest modulus.
    """

    position: Float[np.ndarray, " paths"]
    value: Float[np.ndarray, " paths"]
    bound: float


def constraint_margin(problem: Problem, point: Point, kind: Constraint) -> list[Margin]:
    """Smallest modulus along the actuation paths, or tangent modulus over the strain range.

    Args:
        problem: whose paths are looked at.
        point: the fit.
        kind: "drucker" for second-order work along the path, "slope" for the law's own tangent.

    Returns:
        One margin for each part. The law is stable where the value is >= 0.
    """
    return [_margin(part, point, place, kind) for place, part in enumerate(problem.parts)]


def _margin(part: Part, point: Point, place: int, kind: Constraint) -> Margin:
    paths, count = part.inputs.stations.shape
    rows, nodes = np.arange(paths), np.linspace(0, 1, count)

    def evaluate(at: Float[np.ndarray, "paths k"]) -> Float[np.ndarray, "paths k"]:
        found = report_of(part.with_stations(at), point, place)
        return found.path_modulus if kind == "drucker" else found.slope

    at = np.concatenate([(piece + nodes) / _PIECES for piece in range(_PIECES)])
    values = np.concatenate(
        [evaluate(np.tile(piece, (paths, 1))) for piece in np.split(at, _PIECES)], axis=1
    )
    if not np.isfinite(values).all():
        return Margin(np.zeros(paths), np.full(paths, np.nan), np.nan)
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=np.inf)
    dips = (values <= padded[:, :-2]) & (values <= padded[:, 2:])
    places = np.argsort(np.where(dips, values, np.inf), axis=1, kind="stable")[:, :_MINIMA]
    best, lowest, spread = np.zeros(paths), np.full(paths, np.inf), 0.0
    for k in range(_MINIMA):
        middle = np.where(dips[rows, places[:, k]], at[places[:, k]], best)
        half = 1 / (count - 1) / _PIECES
        for _ in range(_ZOOMS):
            tried = np.clip(middle[:, None] + half * (2 * nodes - 1), 0, 1)
            found = evaluate(tried)
            middle, half = tried[rows, found.argmin(axis=1)], 2 * half / (count - 1)
        spread = max(spread, float(np.ptp(found, axis=1).max()))
        least = found.min(axis=1)
        best, lowest = np.where(least < lowest, middle, best), np.minimum(least, lowest)
        if not dips.sum(axis=1).max() > k + 1:
            break
    return Margin(best, lowest, spread / max(float(np.abs(values).max()), np.finfo(float).tiny))


def rounding_of(point: Point) -> float:
    """Violation of a constraint [Pa] that counts as rounding.

    In parts of the largest coefficient; of a law that all but vanishes, of a thousandth of the largest by
    which one alone would carry the force.
    """
    size = np.linalg.norm(point.A, axis=0)
    alone = np.linalg.norm(point.b) / size[size > 0]
    return FEASIBLE * max(np.abs(point.x).max(initial=0), _VANISHED * alone.max(initial=0.0))


def refine(problem: Problem, best: End, spare: int) -> tuple[End, Problem]:
    """The best of the descents, with the constraint made to hold between the stations.

    Where the law is weakest on a path and violates the constraint, a station is placed, in the place of
    the one that was placed longest ago, and the descent goes on.

    Args:
        problem: of the descents.
        best: their best end.
        spare: number of stations at the end of each path that are free to be placed.

    Returns:
        The end of the last descent with everything known of its fit, and the problem with the
        stations placed.
    """
    kind = problem.constraint
    for done in range(_ROUNDS if kind in ("drucker", "slope") else 0):
        found = constraint_margin(problem, best.point, kind)
        least = -rounding_of(best.point)
        if min(float(one.value.min()) for one in found) >= least:
            break
        parts = []
        for part, one in zip(problem.parts, found, strict=True):
            stations, violated = part.inputs.stations.copy(), one.value < least
            stations[violated, -1 - done % spare] = one.position[violated]
            parts.append(part.with_stations(stations))
        problem = dataclasses.replace(problem, parts=tuple(parts))
        best = descend(problem, best.u)
    return dataclasses.replace(best, point=solve(problem, best.point.parameters)), problem
