"""How the numbers of a muscle vary together: the error band of its force anywhere.

The linear theory (delta method): with J the derivatives of the muscle's numbers in the identified
parameters and C their covariance, J C J^T is that of the numbers. It is kept as the columns of a
root of it: directions of one standard deviation each, independent of one another.
"""

import numpy as np
from jaxtyping import Float

from ..engine import report_of
from ..result import Identification
from .resampling import Bootstrap

_NEGLIGIBLE = 1e-12  # of the largest variance of independent directions: rounding


def muscle_spread(
    result: Identification, drawn: Bootstrap | None = None
) -> Float[np.ndarray, "directions numbers"]:
    """Directions in which the numbers of the mounted muscle vary, one standard deviation each.

    Args:
        result: an identification. What is held or at a bound does not vary.
        drawn: its bootstrap, whose covariance then takes the place of that of linear theory.

    Returns:
        One row for each independent direction, of the arrays of `result.mounted` one after another; no
        rows where there are no standard errors.
    """
    slopes = numbers_by_parameters(result)
    covariance = result.covariance if drawn is None else _covariance(result, drawn)
    return (slopes @ _root(covariance)).T


def numbers_by_parameters(result: Identification) -> Float[np.ndarray, "numbers p"]:
    """Derivatives of the mounted muscle's numbers, the rig's last, in parameters and coefficients."""
    problem, point = result.problem, result.end.point
    part, q = problem.parts[result.place], len(problem.names)
    slope = report_of(part, point, result.place).d_numbers
    own = len(slope)
    # A rigid rig has a compliance too, which does not vary.
    slopes = np.zeros((own + max(len(part.rig), 1), q + point.x.size))
    np.add.at(slopes[:own].T, part.at, slope[:, : part.at.size].T)
    slopes[:own, q + part.coefficients] = slope[:, part.at.size :]
    for place, of_rig in enumerate(part.rig, own):
        slopes[place, of_rig] = 1.0
    return slopes


def _covariance(result: Identification, drawn: Bootstrap) -> Float[np.ndarray, "p p"]:
    """The covariance of bootstrap replicates, with nan for what they hold."""
    problem = result.problem
    moving = [*problem.free, *range(len(problem.names), len(result.covariance))]
    covariance = np.full_like(result.covariance, np.nan)
    covariance[np.ix_(moving, moving)] = np.cov(drawn.samples.T)
    return covariance


def _root(covariance: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p directions"]:
    """R with R R^T = C; rows of what has no variance are zero."""
    std = np.sqrt(np.diag(covariance))
    std = np.where(std > 0, std, 0.0)
    scale = np.outer(std, std)
    correlation = np.where(scale > 0, covariance / np.where(scale > 0, scale, 1.0), 0.0)
    variance, directions = np.linalg.eigh(correlation)
    kept = variance > _NEGLIGIBLE * max(variance.max(initial=0.0), _NEGLIGIBLE)
    return std[:, None] * directions[:, kept] * np.sqrt(variance[kept])
