"""From an identification to the density of its posterior, about the quadratic model at its optimum."""

import dataclasses

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError

from ..descent import descend_many
from ..pure_problem import PureProblem
from ..result import Identification
from ..summary import joint_derivatives
from .box_map import BoxMap
from .density import Coordinates, Density, Layout
from .faces import at_faces, faces_of

Noise = float | tuple[float, float]
"""Standard deviation of a reading where it is known, or the ends of its interval."""

_UNIFORM = 12.0  # 1 / variance of a uniform distribution in the unit box
_HELD = 1e12  # the same of the slack of a held coefficient, which is zero
_SINGULAR = 1e-8  # smallest singular value of columns of unit length that determine coefficients
_REACH, _NODES, _EXCESS = 4.0, 13, 10.0  # of a ridge: standard deviations, optima, log-likelihood
_INSIDE = 1e-3  # of the interval of the noise: the optimum is no nearer to its ends
_FAR = 1e4  # standard deviations: an end of a box that is none


def density_of(result: Identification, noise: Noise) -> tuple[Density, PureProblem]:
    """The density of the posterior, and the problem with its whole constraint.

    Args:
        result: from `identify`.
        noise: in the unit of the weighted residual; of an interval the logarithm is uniform.

    Raises:
        InputError: the readings leave coefficients open, or nothing is free.
    """
    problem, point = result.problem, result.end.point
    free, q, count = problem.free, len(problem.names), problem.force.size
    p = free.size
    _, jacobian, slopes = joint_derivatives(point)
    unknown, sigma, freedom = isinstance(noise, tuple), _scatter(result, noise), _freedom(result)
    rows = np.full(point.residual.size, 1 / problem.noise)
    rows[:count] = 1 / sigma
    residual, jacobian = rows * point.residual, rows[:, None] * jacobian
    scale = _whitening(jacobian[:, q:], problem.linear)

    def of_sampled(derivative: np.ndarray) -> np.ndarray:
        """Derivatives in the unit box and in c, of those in parameters and coefficients."""
        width = (problem.high - problem.low)[free]
        return np.concatenate([derivative[:, free] * width, derivative[:, q:] @ scale], axis=1)

    J, slope = of_sampled(jacobian), of_sampled(slopes)
    H = J.T @ J + np.diag(np.repeat([_UNIFORM, 0.0], [p, len(scale)]))
    spread = np.sqrt(np.einsum("mi,ij,mj->m", slope, np.linalg.inv(H), slope))
    faces = faces_of(problem, point, scale, spread)
    slope, slack = (
        slope[faces.rows],
        (point.G @ point.x - point.h)[faces.rows],
    )
    size = np.linalg.norm(slope[:, p:], axis=1)
    slope, slack = slope / size[:, None], slack / size
    count, r = len(scale), len(faces.slacks)
    others = np.linalg.svd(slope[:, p:], full_matrices=True)[2][len(slope) :]
    others = others if len(slope) else np.eye(count)
    censored = bool((problem.side != 0).any())
    joint = censored or any(part.rig for part in problem.parts)
    covariance = np.linalg.inv(H + _HELD * slope[r:].T @ slope[r:])
    others = others if joint else others[:0]
    sampled = np.zeros((p + r + len(others), p + count))
    sampled[:p, :p] = np.eye(p)
    sampled[p : p + r] = slope[:r]
    sampled[p + r :, p:] = others
    mean, spread = sampled @ -covariance @ (J.T @ residual), sampled @ covariance @ sampled.T
    mean[: p + r] += np.concatenate([result.end.u, slack[:r]])
    reach = _FAR * np.sqrt(np.diag(spread))
    low, high = mean - reach, mean + reach
    low[:p], high[:p] = 0.0, 1.0
    low[p : p + r], high[p : p + r] = 0.0, np.maximum(mean, 0.0)[p : p + r] + reach[p : p + r]
    if isinstance(noise, tuple):
        logs = np.log(sigma), *np.log(noise)
        mean, low, high = (
            np.insert(v, p, at) for v, at in zip((mean, low, high), logs, strict=True)
        )
        spread = np.insert(np.insert(spread, p, 0.0, axis=0), p, 0.0, axis=1)
        spread[p, p] = 1 / (2 * freedom)
    if not mean.size:
        raise InputError("nothing of the posterior is left to sample: every parameter is held")
    box = BoxMap.of(low, high, mean, spread)
    density = Density(
        fit=PureProblem.of(at_faces(problem, faces)),
        force=problem.force,
        side=problem.side,
        layout=Layout(p, unknown, faces.slacks, faces.held, joint),
        coordinates=Coordinates(point.x, scale, size, others),
        noise=np.asarray(sigma),
        prior_noise=np.asarray(problem.noise),
        box=_along_ridge(result, box, sigma, others @ np.linalg.inv(scale)),
    )
    return density, PureProblem.of(problem)


def _along_ridge(
    result: Identification,
    box: BoxMap,
    sigma: float,
    on_x: Float[np.ndarray, "o n"],
) -> BoxMap:
    """The map with the ridge along its leading parameter, by the optima with this one held."""
    problem, end = result.problem, result.end
    lead, p = int(box.order[0]), problem.free.size
    if lead >= p or p < 2:
        return box
    reach = _REACH * box.root[0, 0]
    leads = np.linspace(max(0.0, end.u[lead] - reach), min(1.0, end.u[lead] + reach), _NODES)
    place, held = problem.free[lead], []
    for at in leads:
        low, high = problem.low.copy(), problem.high.copy()
        low[place] = high[place] = low[place] + at * (high - low)[place]
        held.append(dataclasses.replace(problem, low=low, high=high))
    rest = np.delete(np.arange(p), lead)
    ends = descend_many(held, [end.u[rest]] * _NODES)
    excess = np.array([one.cost - end.cost for one in ends]) / sigma**2
    near = [k for k in range(_NODES) if ends[k].converged and excess[k] <= _EXCESS]
    if len(near) < 3:
        return box
    found = np.array([ends[k].u for k in near])
    ridge = {int(at): found[:, k] for k, at in enumerate(rest)}
    x = np.array([ends[k].point.x - end.point.x for k in near])
    ridge |= {len(box.order) - len(on_x) + k: x @ row for k, row in enumerate(on_x)}
    return box.along(leads[near], ridge)


def _freedom(result: Identification) -> int:
    """Readings that are more than needed, at least one."""
    problem = result.problem
    spent = problem.free.size + len(problem.linear)
    return max(int((problem.side == 0).sum()) - spent, 1)


def _scatter(result: Identification, noise: Noise) -> float:
    """The noise that is known, or that of the optimum, inside its interval."""
    if not isinstance(noise, tuple):
        return noise
    problem = result.problem
    own = result.end.point.residual[: problem.force.size][problem.side == 0]
    found = float(np.sqrt(own @ own / _freedom(result)))
    low, high = np.log(noise)
    margin = _INSIDE * (high - low)
    return float(np.exp(np.clip(np.log(max(found, noise[0])), low + margin, high - margin)))


def _whitening(
    columns: Float[np.ndarray, "k n"], names: tuple[str, ...]
) -> Float[np.ndarray, "n n"]:
    """S with the columns of (columns S) orthonormal.

    Raises:
        InputError: the readings and priors leave a coefficient open.
    """
    if not columns.shape[1]:
        return np.zeros((0, 0))
    length = np.linalg.norm(columns, axis=0)
    R = np.linalg.qr(columns / np.where(length > 0, length, 1.0), mode="r")
    if not np.linalg.svd(R, compute_uv=False).min() > _SINGULAR:
        raise InputError(
            f"the readings do not determine {', '.join(dict.fromkeys(names))}: with a flat prior "
            "these have no posterior. Give priors of them (parameters=, --prior), or a lower order"
        )
    return np.linalg.inv(R) / length[:, None]
