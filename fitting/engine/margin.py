"""Stability margins at an optimum: where along its paths a law is weakest, between stations too."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .problem import Part, Point, Problem
from .response import Constraint
from .weakest import weakest


@dataclasses.dataclass(frozen=True)
class Margin:
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


def _margin(part: Part, point: Point, place: int, kind: str) -> Margin:
    paths, count = part.inputs.stations.shape
    parameters, x = point.parameters[part.at], point.x[part.coefficients]
    reached = point.linear[place].reached

    def evaluate(positions: Float[np.ndarray, "paths k"]) -> Float[np.ndarray, "paths k"]:
        at = part.program.at(dataclasses.replace(part.inputs, stations=positions))
        name = "path_modulus" if kind == "drucker" else "slope"
        return getattr(at(parameters, x, reached, name)[2], name)[:paths]

    return Margin(*weakest(evaluate, paths, count))
