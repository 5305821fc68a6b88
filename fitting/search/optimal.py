"""The optimum at the end of a descent, with the covariance of everything that was identified."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ..covariance import Covariance, covariance
from ..descent import End
from ..engine import Point, partial, solve
from ..problem import Problem
from .robust import Robust, pseudo_residual

_STEP = 1e-3  # of a path, by which the bend of a modulus is seen


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
    point: Point,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k p"], Float[np.ndarray, "m p"]]:
    """Weighted residual, its Jacobian and that of the constraint rows, in (parameters, x)."""
    A, _, G, _ = point.programme
    d_residual, d_slack = partial(point)
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
    residual, jacobian, rows = joint_derivatives(point)
    held, rows, bent = held_and_active(problem, end, rows)
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
    spread = covariance(
        jacobian, residual, rows, held, bent=bent, n_priors=n_priors, noise=problem.noise
    )
    at_bound = np.isin(np.arange(len(problem.names)), problem.free) & held[: len(problem.names)]
    return Optimal(problem, end, order, spread, at_bound)


def held_and_active(
    problem: Problem, end: End, rows: Float[np.ndarray, "m p"]
) -> tuple[Bool[np.ndarray, " p"], Float[np.ndarray, "a p"], Float[np.ndarray, "c p"]]:
    """Which of all parameters are held or at a bound, and what the active constraints do to the others.

    Active stations that are neighbours stand for the one point at which the law touches the constraint.
    That point moves with the parameters, so that the constraint bends: of the modulus m(s) with a
    multiplier l the curvature of the cost is more by l m_s m_s^T / m_ss, m_s its gradient's slope in s.

    Args:
        problem: with its stations placed.
        end: the optimum.
        rows: gradients of all constraints in all parameters.

    Returns:
        (held or at a bound; gradients of the active constraints; roots of what they add to the
        curvature).
    """
    point = end.point
    held = np.ones(len(problem.names) + len(problem.linear), bool)
    held[problem.free] = (end.u <= 1e-9) | (end.u >= 1 - 1e-9)
    held[len(problem.names) :] = False
    pull = np.zeros(len(rows))
    pull[point.rows] = point.multipliers
    touches, n_path = _touching(problem, pull)
    others = np.sort(point.rows[point.rows >= n_path])
    means = [pull[one] @ rows[one] / pull[one].sum() for one in touches]
    active = np.concatenate([np.array(means).reshape(-1, rows.shape[1]), rows[others]])
    return held, active, _bent(problem, point, pull, touches)


def _touching(
    problem: Problem, pull: Float[np.ndarray, " m"]
) -> tuple[list[Int[np.ndarray, " k"]], int]:
    """The active rows of each point that is touched on a path, and the number of rows of paths."""
    found, first = [], 0
    for part, rows_of_part in zip(problem.parts, problem.path_rows, strict=True):
        if not rows_of_part:
            continue
        count = part.inputs.stations.shape[1]
        for own in part.inputs.stations:
            active = np.flatnonzero(pull[first : first + count] > 0)
            active = active[np.argsort(own[active])]
            apart = np.flatnonzero(np.diff(own[active]) > 1 / (count - 1)) + 1
            found += [first + rows for rows in np.split(active, apart) if rows.size]
            first += count
    return found, first


def _bent(
    problem: Problem,
    point: Point,
    pull: Float[np.ndarray, " m"],
    touches: Sequence[Int[np.ndarray, " k"]],
) -> Float[np.ndarray, "c p"]:
    """Roots of what the touched points add to the curvature, by differences in their place."""
    p = len(problem.names) + len(problem.linear)
    stations = np.concatenate([part.inputs.stations.ravel() for part in problem.parts])
    middles = [pull[rows] @ stations[rows] / pull[rows].sum() for rows in touches]
    inner = [k for k, s in enumerate(middles) if _STEP < s < 1 - _STEP]
    if not inner:
        return np.zeros((0, p))
    sides = []
    for step in (-_STEP, _STEP):
        moved, first = stations.copy(), 0
        for k in inner:
            moved[touches[k]] = middles[k] + step
        parts = []
        for part in problem.parts:
            own = part.inputs.stations
            parts.append(part.with_stations(moved[first : first + own.size].reshape(own.shape)))
            first += own.size
        other = dataclasses.replace(problem, parts=tuple(parts))
        found = dataclasses.replace(solve(other, point.parameters), x=point.x)
        rows = np.concatenate([partial(found)[1], found.G], axis=1)
        sides.append((rows, found.G @ point.x - found.h))
    (low, m_low), (high, m_high) = sides
    first_of = [touches[k][0] for k in inner]
    slope = (high - low)[first_of] / (2 * _STEP)
    # At the point itself the modulus is zero.
    bend = (m_low + m_high)[first_of] / _STEP**2
    weight = np.array([pull[touches[k]].sum() for k in inner]) / np.where(bend > 0, bend, np.inf)
    return np.sqrt(weight)[:, None] * slope
