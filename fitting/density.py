"""Posterior density of an identification.

Readings are y = F(u) + C(u) x + noise, with u in a box. The prior on x is flat or normal within the set
that the constraint allows. The active rows of the constraint (its faces) have slacks s = N x - h >= 0,
which are sampled in place of an equal number of coefficients. A censored reading contributes the
probability that the force lies on its side of the limit.

References:
    Tobin 1958 (censored readings); Rosenblatt 1952, Ann. Math. Statist. 23(3) (the map of the box).
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr
from jaxtyping import Array, Float, Int

from famjax.boundary.errors import InputError

from .engine import Point
from .problem import PureProblem
from .result import Identification
from .search import descend_many
from .summary import joint_derivatives


class BoxMap(eqx.Module):
    """Smooth bijection from R^d to the interior of a box.

    It maps a normal distribution approximately to a truncated normal distribution. Coordinate by
    coordinate, with t standardised by a quadratic model,

        v_j = c_j + w_j t_j,   c_j = mean_j + sum_{i<j} L_ji t_i,   w_j = L_jj
        sigma(t_j) = (1 - p) sigma(-alpha_j) + p sigma(beta_j),   p = sigma(z_j)

    where sigma is the logistic function and [-alpha_j, beta_j] is the range of t_j within the box. Far from
    the bounds, t = z; near a bound, z is the logit of the distance to it. A ridge in two parameters, one of
    which is at its bound, becomes straight and has unit width. For a curved ridge, c_j is a cubic in the
    first (leading) coordinate. All arrays use the order of the map's coordinates.

    Attributes:
        order: index in the box of each coordinate of the map, shape (d,).
        low, high: the box, shape (d,).
        mean: mean of the quadratic model, possibly outside the box, shape (d,).
        root: lower triangle L of its covariance L L^T, shape (d, d).
        curve: coefficients of c_j as a polynomial in t_0, in ascending powers, without the terms in other
            coordinates, shape (d, 4).
    """

    order: Int[np.ndarray, " d"]
    low: Float[np.ndarray, " d"]
    high: Float[np.ndarray, " d"]
    mean: Float[np.ndarray, " d"]
    root: Float[np.ndarray, "d d"]
    curve: Float[np.ndarray, "d 4"]

    @classmethod
    def of(
        cls,
        low: Float[np.ndarray, " d"],
        high: Float[np.ndarray, " d"],
        mean: Float[np.ndarray, " d"],
        covariance: Float[np.ndarray, "d d"],
    ) -> "BoxMap":
        """Return the map for a box and a quadratic model, with the coordinate nearest its bounds first."""
        std = np.sqrt(np.diag(covariance))
        inside = np.minimum(np.minimum(mean - low, high - mean) / std, 3.0)
        order = np.lexsort((-std / (high - low), inside))
        root = np.linalg.cholesky(covariance[np.ix_(order, order)])
        curve = np.zeros((low.size, 4))
        curve[:, 0], curve[1:, 1] = mean[order], root[1:, 0]
        return cls(order, low[order], high[order], mean[order], root, curve)

    def along(self, leads: Float[np.ndarray, " k"], ridge: dict[int, np.ndarray]) -> "BoxMap":
        """Return the map with its centres moved onto a ridge.

        Args:
            leads: at least two values of the leading coordinate.
            ridge: centres of other coordinates at these values, by index in the box.
        """
        t = (leads - self.mean[0]) / self.root[0, 0]
        powers = t[:, None] ** np.arange(min(4, leads.size))
        curve = self.curve.copy()
        for j, place in enumerate(self.order.tolist()):
            if j and place in ridge:
                curve[j] = 0.0
                curve[j, : powers.shape[1]] = np.linalg.lstsq(powers, ridge[place], rcond=None)[0]
        return eqx.tree_at(lambda m: m.curve, self, curve)

    def __call__(self, z: Float[Array, " d"]) -> tuple[Float[Array, " d"], Float[Array, ""]]:
        """Return the point in the box and log |dv/dz|."""
        log_slope, t, v = jnp.zeros(()), jnp.zeros_like(z), jnp.zeros_like(z)
        for j in range(z.shape[0]):
            width = self.root[j, j]
            centre = jnp.polyval(jnp.asarray(self.curve[j, ::-1]), t[0])
            centre = centre + jnp.asarray(self.root[j, 1:]) @ t[1:]
            ends = (centre - self.low[j]) / width, (self.high[j] - centre) / width
            t_j, slope = _within(*ends, z[j])
            log_slope = log_slope + jnp.log(width) + slope
            t, v = t.at[j].set(t_j), v.at[j].set(centre + width * t_j)
        return jnp.zeros_like(z).at[jnp.asarray(self.order)].set(v), log_slope


def _within(alpha: Array, beta: Array, z: Array) -> tuple[Array, Array]:
    """Return t in (-alpha, beta) and log dt/dz, computed with logarithms of positive sums."""
    log = jax.nn.log_sigmoid
    up, down = log(z), log(-z)
    below = jnp.logaddexp(log(-alpha) + down, log(beta) + up)
    above = jnp.logaddexp(log(alpha) + down, log(-beta) + up)
    # sigma(beta) - sigma(-alpha), without cancellation
    span = log(alpha) + log(beta) + jnp.log(-jnp.expm1(-(alpha + beta)))
    return below - above, span + up + down - below - above


Noise = float | tuple[float, float]
"""Known standard deviation of a reading, or the interval (low, high) in which it lies."""


class Density(eqx.Module):
    """Log posterior density as a function of z in R^d, which is approximately standard normal.

    The vector v = box(z) contains the geometry, the slacks, other combinations of the coefficients, and the
    logarithm of the noise if it is unknown. The coefficients are x = centre + scale c, with c nearly
    standard normal.

    Attributes:
        problem: the problem with its full constraint.
        force: readings [N]; the limit if censored.
        side: 0 for an uncensored reading, 1 if the force is at most the limit, -1 if it is at least the
            limit.
        geometry: number of parameters in the unit box.
        faces: rows of the constraint whose slack is sampled.
        centre: coefficients at c = 0, shape (n,).
        scale: transformation from c to the coefficients, shape (n, n).
        face_scale: scale of the rows of faces [Pa], shape (r,).
        others: combinations of c that the faces leave free at the optimum, shape (n - r, n).
        noise: known standard deviation, in the unit of a weighted residual; None if sampled.
        prior_noise: noise assumed in the weights of the prior rows.
        box: map to v.
    """

    problem: PureProblem
    force: Float[np.ndarray, " points"]
    side: Int[np.ndarray, " points"]
    geometry: int = eqx.field(static=True)
    faces: tuple[int, ...] = eqx.field(static=True)
    centre: Float[np.ndarray, " n"]
    scale: Float[np.ndarray, "n n"]
    face_scale: Float[np.ndarray, " r"]
    others: Float[np.ndarray, "o n"]
    noise: Float[np.ndarray, ""] | None
    prior_noise: Float[np.ndarray, ""]
    box: BoxMap

    def __call__(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return log p(z | y), up to a constant; -inf where the constraint is violated."""
        return self._evaluate(z)[0]

    def draw(
        self, z: Float[Array, " d"]
    ) -> tuple[Float[Array, " q"], Float[Array, " n"], Float[Array, ""]]:
        """Return the parameters [SI], coefficients and noise at a point z."""
        return self._evaluate(z)[1:]

    def _evaluate(self, z: Float[Array, " d"]) -> tuple[Array, Array, Array, Array]:
        """Return the log density, parameters, coefficients and noise."""
        v, found = self.box(z)
        first, last = self.geometry, self.geometry + len(self.faces)
        known = last + len(self.others)
        p = self.problem.parameters(v[:first])
        sigma = jnp.exp(v[-1]) if self.noise is None else jnp.asarray(self.noise)
        force, none = jnp.asarray(self.force), jnp.zeros(self.centre.shape)
        A, b, G, h = self.problem.programme(p, none, force, force)
        at = np.array(self.faces, int)
        N = (G[at] / self.face_scale[:, None]) @ self.scale
        offset = (h[at] - G[at] @ self.centre) / self.face_scale
        rows = jnp.concatenate([N, jnp.asarray(self.others)])
        c = jnp.linalg.solve(rows, jnp.concatenate([v[first:last] + offset, v[last:known]]))
        x = self.centre + self.scale @ c
        residual, count = A @ x - b, self.force.shape[0]
        if self.problem.compliant:
            exact, _ = self.problem.exact(p, x, force, force)
            residual = jnp.concatenate([exact[:count], residual[count:]])
        prior_rows, means = self.problem.priors
        priors = jnp.concatenate([residual[count:], prior_rows @ p - means]) / self.prior_noise
        side, r = jnp.asarray(self.side), residual[:count] / sigma
        each = jnp.where(
            side == 0, -(r**2) / 2 - jnp.log(sigma), log_ndtr(jnp.where(side == 0, 0.0, -side * r))
        )
        found += jnp.sum(each) - priors @ priors / 2 - jnp.linalg.slogdet(rows)[1]
        rounding = 1e-9 * jnp.max(jnp.abs(x), initial=0.0)
        held = jnp.min(G @ x - h, initial=jnp.inf) >= -rounding
        return jnp.where(held & jnp.isfinite(found), found, -jnp.inf), p, x, sigma


def _faces(
    point: Point, scale: Float[np.ndarray, "n n"], spread: Float[np.ndarray, " m"]
) -> tuple[int, ...]:
    """Return the rows of the constraint whose slack is sampled.

    These are the active rows, then the nearest rows within three standard deviations, all in different
    directions.

    Args:
        point: optimum of the fit.
        scale: transformation to coefficients that are approximately standard normal.
        spread: standard deviations of the slacks of all rows.
    """
    G = point.G @ scale
    slack = point.G @ point.x - point.h
    size = np.linalg.norm(G, axis=1)
    push = point.multipliers * size[point.rows]
    away = np.where(spread > 0, slack / np.where(spread > 0, spread, 1.0), np.inf)
    nearest = np.argsort(away, kind="stable")
    order = [*point.rows[np.argsort(-push, kind="stable")], *nearest[away[nearest] < 3.0]]
    faces, directions = list[int](), list[np.ndarray]()
    for row in order:
        if not size[row] > 0 or len(directions) == len(scale):
            continue
        known = np.linalg.qr(np.array(directions).reshape(-1, len(scale)).T)[0]
        direction = G[row] / size[row]
        if np.linalg.norm(direction - known @ (known.T @ direction)) > 0.01:
            faces.append(int(row))
            directions.append(direction)
    return tuple(faces)


def density_of(result: Identification, noise: Noise) -> Density:
    """Set up the posterior density of an identification.

    Args:
        result: fit from `identify`.
        noise: standard deviation in the unit of the weighted residual, or an interval in which its
            logarithm is uniformly distributed.

    Raises:
        InputError: the readings do not determine the coefficients, a coefficient is held fixed, or no
            parameter is free.
    """
    problem, point = result.problem, result.end.point
    free, q, count = problem.free, len(problem.names), problem.force.size
    p, n = free.size, len(problem.linear)
    if (problem.coefficient_min == problem.coefficient_max).any():
        raise InputError(
            "a coefficient that is held fixed cannot be sampled: use another law or order"
        )
    _, jacobian, slopes = joint_derivatives(point)
    freedom = max(int((problem.side == 0).sum()) - p - n, 1)
    if not isinstance(noise, tuple):
        sigma = noise
    else:
        own = point.residual[:count][problem.side == 0]
        inside = (noise[1] / noise[0]) ** 1e-3
        scatter = np.sqrt(own @ own / freedom)
        sigma = float(np.clip(scatter, noise[0] * inside, noise[1] / inside))
    rows = np.full(point.residual.size, 1 / problem.noise)
    rows[:count] = 1 / sigma
    residual, jacobian = rows * point.residual, rows[:, None] * jacobian
    scale = _whitening(jacobian[:, q:], problem.linear)

    def of_sampled(derivative: np.ndarray) -> np.ndarray:
        """Transform derivatives to the coordinates of the unit box and to c."""
        width = (problem.high - problem.low)[free]
        return np.concatenate([derivative[:, free] * width, derivative[:, q:] @ scale], axis=1)

    J, slope = of_sampled(jacobian), of_sampled(slopes)
    # 12 = 1 / variance of a uniform distribution in the unit box
    H = J.T @ J + np.diag(np.repeat([12.0, 0.0], [p, n]))
    spread = np.sqrt(np.einsum("mi,ij,mj->m", slope, np.linalg.inv(H), slope))
    faces = _faces(point, scale, spread)
    rows, r = list(faces), len(faces)
    size = np.linalg.norm(slope[rows, p:], axis=1)
    N = slope[rows] / size[:, None]
    others = np.linalg.svd(N[:, p:], full_matrices=True)[2][r:] if r else np.eye(n)
    sampled = np.concatenate([np.eye(p, p + n), N, np.pad(others, ((0, 0), (p, 0)))])
    inverse = np.linalg.inv(H)
    spread = sampled @ inverse @ sampled.T
    slack = (point.G @ point.x - point.h)[rows] / size
    mean = -sampled @ inverse @ (J.T @ residual)
    mean[: p + r] += np.concatenate([result.end.u, slack])
    reach = 1e4 * np.sqrt(np.diag(spread))  # practically unbounded
    low, high = mean - reach, mean + reach
    low[:p], high[:p] = 0.0, 1.0
    low[p : p + r], high[p : p + r] = 0.0, np.maximum(mean, 0.0)[p : p + r] + reach[p : p + r]
    if isinstance(noise, tuple):
        mean = np.append(mean, np.log(sigma))
        low, high = (np.append(v, at) for v, at in zip((low, high), np.log(noise), strict=True))
        spread = np.pad(spread, (0, 1))
        spread[-1, -1] = 1 / (2 * freedom)
    if not mean.size:
        raise InputError(
            "there is nothing to sample because every parameter is held fixed: free at least one"
        )
    box = BoxMap.of(low, high, mean, spread)
    return Density(
        problem=PureProblem.of(problem),
        force=problem.force,
        side=problem.side,
        geometry=p, faces=faces,
        centre=point.x, scale=scale, face_scale=size, others=others,
        noise=None if isinstance(noise, tuple) else np.asarray(noise),
        prior_noise=np.asarray(problem.noise),
        box=_along_ridge(result, box, sigma, p + r, others @ np.linalg.inv(scale)),
    )  # fmt: skip


def _along_ridge(
    result: Identification, box: BoxMap, sigma: float, first: int, on_x: Float[np.ndarray, "o n"]
) -> BoxMap:
    """Make the map follow the ridge through the optima at fixed values of its leading parameter."""
    problem, end = result.problem, result.end
    lead, p = int(box.order[0]), problem.free.size
    if lead >= p or p < 2:
        return box
    reach = 4.0 * box.root[0, 0]
    leads = np.linspace(max(0.0, end.u[lead] - reach), min(1.0, end.u[lead] + reach), 13)
    place, held = problem.free[lead], []
    for at in leads:
        low, high = problem.low.copy(), problem.high.copy()
        low[place] = high[place] = low[place] + at * (high - low)[place]
        held.append(dataclasses.replace(problem, low=low, high=high))
    rest = np.delete(np.arange(p), lead)
    ends = descend_many(held, [end.u[rest]] * len(leads))
    excess = np.array([one.cost - end.cost for one in ends]) / sigma**2
    near = [k for k, one in enumerate(ends) if one.converged and excess[k] <= 10.0]
    if len(near) < 3:
        return box
    found = np.array([ends[k].u for k in near])
    ridge = {int(at): found[:, k] for k, at in enumerate(rest)}
    x = np.array([ends[k].point.x - end.point.x for k in near])
    ridge |= {first + k: x @ row for k, row in enumerate(on_x)}
    return box.along(leads[near], ridge)


def _whitening(
    columns: Float[np.ndarray, "k n"], names: tuple[str, ...]
) -> Float[np.ndarray, "n n"]:
    """Return S such that the columns of (columns S) are orthonormal.

    Raises:
        InputError: the readings and priors do not determine a coefficient.
    """
    if not columns.shape[1]:
        return np.zeros((0, 0))
    length = np.linalg.norm(columns, axis=0)
    R = np.linalg.qr(columns / np.where(length > 0, length, 1.0), mode="r")
    if not np.linalg.svd(R, compute_uv=False).min() > 1e-8:
        named = ", ".join(dict.fromkeys(names))
        raise InputError(f"the readings do not determine {named}: add priors, or use a lower order")
    return np.linalg.inv(R) / length[:, None]
