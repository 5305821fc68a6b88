"""The optimum at the end of a descent, with the covariance of everything that was identified."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ..engine.covariance import Covariance, covariance
from ..engine.descent import End
from ..engine.problem import Point, Problem
from .robust import Robust, pseudo_residual


@dataclasses.dataclass(frozen=True)
class Optimal:
    """An optimum and what follows from it for a reader.

    Attributes:
        problem: with its stations placed.
        end: of the best descent.
        order: number of coefficients of one law.
        spread: covariance of the nonlinear parameters and then the coefficients.
        at_bound: nonlinear parameters on a bound.
    """

    problem: Problem
    end: End
    order: int
    spread: Covariance
    at_bound: Bool[np.ndarray, " q"]

    @property
    def point(self) -> Point:
        """The fit at the optimum."""
        return self.end.point

    @property
    def coefficients(self) -> Float[np.ndarray, "nodes order"]:
        """Coefficients [Pa] of every node."""
        return self.point.x.reshape(-1, self.order)


def joint_derivatives(
    problem: Problem, point: Point
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k p"], Float[np.ndarray, "m p"]]:
    """Weighted residual, its Jacobian and that of the constraint rows, in (parameters, x)."""
    A, _, G, _ = point.programme
    d_residual, d_slack = problem.partial(point)
    columns = np.zeros((len(d_residual), A.shape[1]))
    columns[: len(A)] = A
    return (
        point.residual,
        np.concatenate([d_residual, columns], axis=1),
        np.concatenate([d_slack, G], axis=1),
    )


def optimal(problem: Problem, end: End, order: int, robust: Robust | None = None) -> Optimal:
    """The optimum at the end of a descent, with its covariance; `robust` as the problem is weighed."""
    point = end.point
    residual, jacobian, rows = joint_derivatives(problem, point)
    held, rows = held_and_active(problem, end, rows)
    n_priors = residual.size - problem.force.size
    # A censored reading that is off says nothing of the noise or the parameters.
    off = np.zeros(residual.size, bool)
    off[: problem.force.size] = (problem.side != 0) & (residual[: problem.force.size] == 0)
    residual, jacobian = residual[~off], jacobian[~off]
    if robust is not None:
        # The readings in their own weights again, their residuals as Huber's theory counts them.
        own = np.concatenate([1 / robust.weight, np.ones(n_priors)])
        unknowns = int(np.sum(~held)) - len(set(map(tuple, rows)))
        jacobian = own[:, None] * jacobian
        residual = pseudo_residual(
            own * residual, robust.weight.size, robust.threshold, max(unknowns, 1)
        )
    spread = covariance(jacobian, residual, rows, held, n_priors=n_priors, noise=problem.noise)
    at_bound = np.isin(np.arange(len(problem.names)), problem.free) & held[: len(problem.names)]
    return Optimal(problem, end, order, spread, at_bound)


def held_and_active(
    problem: Problem, end: End, rows: Float[np.ndarray, "m p"]
) -> tuple[Bool[np.ndarray, " p"], Float[np.ndarray, "a p"]]:
    """Which of all parameters are held or at a bound, and of the constraints' rows the active ones."""
    held = np.ones(len(problem.names) + len(problem.linear), bool)
    held[problem.free] = (end.u <= 1e-9) | (end.u >= 1 - 1e-9)
    held[len(problem.names) :] = False
    return held, rows[np.sort(end.point.optimum.rows)]
