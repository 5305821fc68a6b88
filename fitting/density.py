"""Posterior density of an identification, with the coefficients integrated where they are normal.

Readings are y = F(u) + C(u) x + noise, with u in a box and a flat or normal prior of x on the set allowed
by the constraint. For given u and noise, the coefficients are normal apart from the constraint. Then
p(y | u) is the mass of this normal, exp(-r^2/2) / det(Q)^1/2 with Q = A^T A of the weighted columns. The
active rows of the constraint, its faces, have slacks s = N x - h that are sampled, s >= 0; the normal
density of s replaces that part of the mass. With censored readings nothing is normal, so the coefficients
are sampled.

References:
    Golub & Pereyra 1973 (separable models); Tobin 1958 (censored readings); Rosenblatt 1952, Ann. Math.
    Statist. 23(3) (the map of the box).
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr
from jaxtyping import Array, Bool, Float, Int

from famjax.boundary.errors import InputError

from .convex import inverse_lower
from .engine import Point
from .problem import Problem, PureProblem
from .result import Identification
from .search import descend_many
from .summary import joint_derivatives


class BoxMap(eqx.Module):
    """Smooth bijection from R^d to the inside of a box; it maps a normal closely to a truncated normal.

    Coordinate by coordinate, with t standardised by a quadratic model,

        v_j = c_j + w_j t_j,   c_j = mean_j + sum_{i<j} L_ji t_i,   w_j = L_jj
        sigma(t_j) = (1 - p) sigma(-alpha_j) + p sigma(beta_j),   p = sigma(z_j)

    where sigma is the logistic function and [-alpha_j, beta_j] the range of t_j within the box. Far from
    the bounds t = z; at a bound it is the logit of the distance. A ridge of two parameters, one of them at
    its bound, becomes straight and of unit width. For a curved ridge, c_j is a cubic in the first
    coordinate, the leading one. Every array is in the map's own order.

    Attributes:
        order: index in the box of each coordinate of the map, shape (d,).
        low, high: the box, shape (d,).
        mean: mean of the quadratic model, possibly outside the box, shape (d,).
        root: lower triangle L of its covariance L L^T, shape (d, d).
        curve: c_j as a polynomial in t_0, rising powers, without the other terms, shape (d, 4).
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
        """Map of a box and a quadratic model; the coordinate most affected by its bounds leads."""
        std = np.sqrt(np.diag(covariance))
        inside = np.minimum(np.minimum(mean - low, high - mean) / std, 3.0)
        order = np.lexsort((-std / (high - low), inside))
        root = np.linalg.cholesky(covariance[np.ix_(order, order)])
        curve = np.zeros((low.size, 4))
        curve[:, 0], curve[1:, 1] = mean[order], root[1:, 0]
        return cls(order, low[order], high[order], mean[order], root, curve)

    def along(self, leads: Float[np.ndarray, " k"], ridge: dict[int, np.ndarray]) -> "BoxMap":
        """Return the map with centres that follow a ridge.

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
        """Point of the box and log |dv/dz|."""
        log_slope, t, v = jnp.zeros(()), [], []
        for j in range(z.shape[0]):
            root = jnp.asarray(self.root[j])
            width, curve = root[j], jnp.asarray(self.curve[j])
            centre = curve[0]
            if j:
                centre = centre + t[0] * (curve[1] + t[0] * (curve[2] + t[0] * curve[3]))
            centre = centre + sum((root[i] * t[i] for i in range(1, j)), start=jnp.zeros(()))
            ends = (centre - self.low[j]) / width, (self.high[j] - centre) / width
            t_j, slope = _within(*ends, z[j])
            log_slope = log_slope + jnp.log(width) + slope
            t.append(t_j)
            v.append(centre + width * t_j)
        return jnp.zeros_like(z).at[jnp.asarray(self.order)].set(jnp.stack(v)), log_slope


def _within(alpha: Array, beta: Array, z: Array) -> tuple[Array, Array]:
    """T in (-alpha, beta) and log dt/dz, by logarithms of positive sums."""
    log = jax.nn.log_sigmoid
    up, down = log(z), log(-z)
    below = jnp.logaddexp(log(-alpha) + down, log(beta) + up)
    above = jnp.logaddexp(log(alpha) + down, log(-beta) + up)
    # sigma(beta) - sigma(-alpha), without cancellation
    span = log(alpha) + log(beta) + jnp.log(-jnp.expm1(-(alpha + beta)))
    return below - above, span + up + down - below - above


def _posed_at_faces(
    problem: Problem, point: Point, scale: Float[np.ndarray, "n n"], spread: Float[np.ndarray, " m"]
) -> tuple[Problem, Int[np.ndarray, " r"], tuple[int, ...], tuple[int, ...]]:
    """Pose the constraint only at its faces: active rows, then the nearest ones, of different directions.

    Args:
        problem: problem of the fit.
        point: its optimum.
        scale: transformation to coefficients that are about standard normal.
        spread: standard deviations of the slacks of all rows.

    Returns:
        (problem at the faces; rows of the faces and then of held coefficients in the original problem;
        places of the faces, and of the held coefficients, whose slack is zero, among the new rows).
    """
    G, n = point.G @ scale, len(problem.linear)
    slack = point.G @ point.x - point.h
    size = np.linalg.norm(G, axis=1)
    # The last rows are the bounds on coefficients, lower ones first.
    n_path = len(G) - 2 * n
    held = n_path + np.flatnonzero(problem.coefficient_min == problem.coefficient_max)
    both = {*held.tolist(), *(held + n).tolist()}
    directions = [G[row] / size[row] for row in held]
    chosen = []
    push = point.multipliers * size[point.rows]
    away = np.where(spread > 0, slack / np.where(spread > 0, spread, 1.0), np.inf)
    nearest = np.argsort(away, kind="stable")
    # Rows within three standard deviations exclude draws.
    order = [*point.rows[np.argsort(-push, kind="stable")].tolist(),
             *nearest[away[nearest] < 3.0].tolist()]  # fmt: skip
    for row in order:
        if row in both or not size[row] > 0 or len(directions) == len(scale):
            continue
        known = np.linalg.qr(np.array(directions).reshape(-1, len(scale)).T)[0]
        direction = G[row] / size[row]
        if np.linalg.norm(direction - known @ (known.T @ direction)) > 0.01:
            chosen.append(row)
            directions.append(direction)
    rows = np.array(sorted(chosen), int)
    parts, places, first, first_new = [], [], 0, 0
    for part in problem.parts:
        paths, count = part.inputs.stations.shape
        count *= problem.constraint in {"slope", "drucker"}
        here = rows[(rows >= first) & (rows < first + paths * count)] - first
        path, station = np.divmod(here, max(count, 1))
        places += (first_new + path * here.size + np.arange(here.size)).tolist()
        parts.append(part.with_stations(np.tile(part.inputs.stations[path, station], (paths, 1))))
        first, first_new = first + paths * count, first_new + paths * here.size
    places += (first_new - n_path + rows[rows >= n_path]).tolist()
    at_held = tuple((first_new - n_path + held).tolist())
    posed = dataclasses.replace(problem, parts=tuple(parts))
    return posed, np.concatenate([rows, held]), tuple(places), at_held


class Density(eqx.Module):
    """Logarithm of the posterior at points z of R^d.

    The sampled vector v = box(z) contains geometry, log of the noise, slacks and coefficients. The
    coefficients are x = centre + scale c, with c about standard normal.

    Attributes:
        fit: problem with its constraint posed at the faces.
        force: readings [N]; the limit if censored.
        side: 0 for a reading, 1 if the force is at most the limit, -1 if it is at least the limit.
        geometry: number of parameters in the unit box.
        noise_sampled: true if the noise is sampled.
        slacks: places of the faces among the rows of the constraint.
        held: places of the bounds of held coefficients, which are equations.
        joint: true if the coefficients are sampled and not integrated.
        centre: shape (n,).
        scale: shape (n, n).
        face_scale: scale of the rows of faces and held coefficients [Pa], shape (r,).
        others: rows on c left free by these at the optimum, shape (n - r, n).
        noise: known standard deviation, in the unit of a weighted residual.
        prior_noise: noise for which the rows of priors were weighted.
        box: map to v.
    """

    fit: PureProblem
    force: Float[np.ndarray, " points"]
    side: Int[np.ndarray, " points"]
    geometry: int = eqx.field(static=True)
    noise_sampled: bool = eqx.field(static=True)
    slacks: tuple[int, ...] = eqx.field(static=True)
    held: tuple[int, ...] = eqx.field(static=True)
    joint: bool = eqx.field(static=True)
    centre: Float[np.ndarray, " n"]
    scale: Float[np.ndarray, "n n"]
    face_scale: Float[np.ndarray, " r"]
    others: Float[np.ndarray, "o n"]
    noise: Float[np.ndarray, ""]
    prior_noise: Float[np.ndarray, ""]
    box: BoxMap

    def __call__(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log p(v | y) + log |dv/dz|, up to a constant."""
        v, log_slope = self.box(z)
        return self.log_posterior(v) + log_slope

    def parts(self, v: Float[Array, " d"]) -> tuple[Array, Array, Array, Array]:
        """Geometry in the unit box, noise, scaled slacks, other coefficients."""
        p, r = self.geometry, len(self.slacks)
        first = p + self.noise_sampled
        sigma = jnp.exp(v[p]) if self.noise_sampled else jnp.asarray(self.noise)
        slack = jnp.concatenate([v[first : first + r], jnp.zeros(len(self.held))])
        return v[:p], sigma, slack, v[first + r :]

    def log_posterior(self, v: Float[Array, " d"]) -> Float[Array, ""]:
        """Log p(v | y), up to a constant."""
        u, sigma, slack, rest = self.parts(v)
        p = self.fit.parameters(u)
        A, b, N, offset = self._programme(p, sigma)
        rows, means = self.fit.priors
        prior = jnp.asarray((rows @ p - means) / self.prior_noise)
        measured = jnp.sum(jnp.asarray(self.side == 0))
        found = -measured * jnp.log(sigma) - prior @ prior / 2
        if self.joint:
            c, log_volume = self._coefficients(N, offset, slack, rest)
            return found + log_volume + self._log_likelihood(A @ c - b, p, c, sigma)
        lower, inverse, middle = _normal(A, b)
        r = A @ middle - b
        found = found - r @ r / 2 - jnp.sum(jnp.log(jnp.diagonal(lower)))
        if slack.size:
            # The density of the slacks is that of N c - offset, with c normal.
            half = N @ inverse.T
            spread = jnp.linalg.cholesky(half @ half.T)
            away = inverse_lower(spread) @ (slack - (N @ middle - offset))
            found = found - away @ away / 2 - jnp.sum(jnp.log(jnp.diagonal(spread)))
        return found

    def draw(
        self, whole: PureProblem, v: Float[Array, " d"], key: Array
    ) -> tuple[Float[Array, " q"], Float[Array, " n"], Float[Array, ""], Bool[Array, ""]]:
        """Draw parameters [SI], coefficients and noise, and check the constraint.

        Args:
            whole: the problem with its whole constraint.
            v: sampled vector.
            key: random key for the coefficients.
        """
        u, sigma, slack, rest = self.parts(v)
        p = self.fit.parameters(u)
        A, b, N, offset = self._programme(p, sigma)
        if self.joint:
            c, _ = self._coefficients(N, offset, slack, rest)
        else:
            _, inverse, middle = _normal(A, b)
            c = middle + inverse.T @ jax.random.normal(key, middle.shape)
            if slack.size:
                half = N @ inverse.T
                back = jnp.linalg.solve(half @ half.T, slack - (N @ c - offset))
                c = c + inverse.T @ (half.T @ back)
        x = jnp.asarray(self.centre + self.scale @ c)
        _, _, G, h = self._posed(whole, p)
        rounding = 1e-9 * jnp.max(jnp.abs(x), initial=0.0)
        held = jnp.min(G @ x - h, initial=jnp.inf) >= -rounding
        return p, x, sigma, held & jnp.all(jnp.isfinite(x))

    def _posed(self, of: PureProblem, p: Array) -> tuple[Array, Array, Array, Array]:
        """A, b, G and h about zero coefficients, with the weights of the readings."""
        force = jnp.asarray(self.force)
        none = jnp.zeros(self.centre.shape)
        return of.programme(p, none, force, force)

    def _programme(self, p: Array, sigma: Array) -> tuple[Array, Array, Array, Array]:
        """A, b of the standardised residual A c - b, and N, offset of the slacks N c - offset."""
        A, b, G, h = self._posed(self.fit, p)
        count = self.force.shape[0]
        scale = jnp.where(jnp.arange(A.shape[0]) < count, 1 / sigma, 1 / self.prior_noise)
        at = np.array(self.slacks + self.held, int)
        N, h = G[at] / self.face_scale[:, None], h[at] / self.face_scale
        b = scale * (b - A @ self.centre)
        offset = h - N @ self.centre
        return scale[:, None] * (A @ self.scale), b, jnp.asarray(N @ self.scale), offset

    def _coefficients(
        self, N: Array, offset: Array, slack: Array, rest: Array
    ) -> tuple[Array, Array]:
        """Coefficients from slacks and others, and log |dc| of the volume element."""
        if not slack.size:
            return jnp.asarray(self.others.T @ rest), jnp.zeros(())
        rows = jnp.concatenate([N, jnp.asarray(self.others)])
        c = jnp.linalg.solve(rows, jnp.concatenate([slack + offset, rest]))
        return c, -jnp.linalg.slogdet(rows)[1]

    def _log_likelihood(self, residual: Array, p: Array, c: Array, sigma: Array) -> Array:
        """Log likelihood of readings and priors, without the determinant of the noise."""
        count = self.force.shape[0]
        if self.fit.compliant:
            x = jnp.asarray(self.centre + self.scale @ c)
            exact, _ = self.fit.exact(p, x, jnp.asarray(self.force), jnp.asarray(self.force))
            residual = jnp.concatenate([exact[:count] / sigma, residual[count:]])
        priors, r, side = residual[count:], residual[:count], jnp.asarray(self.side)
        censored = log_ndtr(jnp.where(side == 0, 0.0, -side * r))
        return jnp.sum(jnp.where(side == 0, -(r**2) / 2, censored)) - priors @ priors / 2


def _normal(A: Array, b: Array) -> tuple[Array, Array, Array]:
    """Lower triangle of A^T A, its inverse, and the least-squares coefficients."""
    lower = jnp.linalg.cholesky(A.T @ A)
    inverse = inverse_lower(lower)
    return lower, inverse, inverse.T @ (inverse @ (A.T @ b))


Noise = float | tuple[float, float]
"""Known standard deviation of a reading, or the ends of its interval."""


def density_of(result: Identification, noise: Noise) -> tuple[Density, PureProblem]:
    """Set up the posterior density, and the problem with its whole constraint.

    Args:
        result: from `identify`.
        noise: in the unit of the weighted residual; its logarithm is uniform in an interval.

    Raises:
        InputError: the readings do not determine the coefficients, or nothing is free.
    """
    problem, point = result.problem, result.end.point
    free, q, count = problem.free, len(problem.names), problem.force.size
    p = free.size
    _, jacobian, slopes = joint_derivatives(point)
    sigma, freedom = _scatter(result, noise), _freedom(result)
    rows = np.full(point.residual.size, 1 / problem.noise)
    rows[:count] = 1 / sigma
    residual, jacobian = rows * point.residual, rows[:, None] * jacobian
    scale = _whitening(jacobian[:, q:], problem.linear)

    def of_sampled(derivative: np.ndarray) -> np.ndarray:
        """Transform derivatives to the unit box and to c."""
        width = (problem.high - problem.low)[free]
        return np.concatenate([derivative[:, free] * width, derivative[:, q:] @ scale], axis=1)

    J, slope = of_sampled(jacobian), of_sampled(slopes)
    # 12 = 1 / variance of a uniform distribution in the unit box
    H = J.T @ J + np.diag(np.repeat([12.0, 0.0], [p, len(scale)]))
    spread = np.sqrt(np.einsum("mi,ij,mj->m", slope, np.linalg.inv(H), slope))
    posed, rows, slacks, held = _posed_at_faces(problem, point, scale, spread)
    slope, slack = slope[rows], (point.G @ point.x - point.h)[rows]
    size = np.linalg.norm(slope[:, p:], axis=1)
    slope, slack = slope / size[:, None], slack / size
    count, r = len(scale), len(slacks)
    others = np.linalg.svd(slope[:, p:], full_matrices=True)[2][len(slope) :]
    others = others if len(slope) else np.eye(count)
    censored = bool((problem.side != 0).any())
    joint = censored or any(part.rig for part in problem.parts)
    covariance = np.linalg.inv(H + 1e12 * slope[r:].T @ slope[r:])  # the slack of held rows is zero
    others = others if joint else others[:0]
    sampled = np.zeros((p + r + len(others), p + count))
    sampled[:p, :p] = np.eye(p)
    sampled[p : p + r] = slope[:r]
    sampled[p + r :, p:] = others
    mean, spread = sampled @ -covariance @ (J.T @ residual), sampled @ covariance @ sampled.T
    mean[: p + r] += np.concatenate([result.end.u, slack[:r]])
    reach = 1e4 * np.sqrt(np.diag(spread))  # practically unbounded
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
        raise InputError("there is nothing to sample, as every parameter is held: free one")
    box = BoxMap.of(low, high, mean, spread)
    density = Density(
        fit=PureProblem.of(posed),
        force=problem.force,
        side=problem.side,
        geometry=p, noise_sampled=isinstance(noise, tuple), slacks=slacks, held=held, joint=joint,
        centre=point.x, scale=scale, face_scale=size, others=others,
        noise=np.asarray(sigma),
        prior_noise=np.asarray(problem.noise),
        box=_along_ridge(result, box, sigma, others @ np.linalg.inv(scale)),
    )  # fmt: skip
    return density, PureProblem.of(problem)


def _along_ridge(
    result: Identification, box: BoxMap, sigma: float, on_x: Float[np.ndarray, "o n"]
) -> BoxMap:
    """Let the map follow the ridge along its leading parameter, through optima with this one held."""
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
    ridge |= {len(box.order) - len(on_x) + k: x @ row for k, row in enumerate(on_x)}
    return box.along(leads[near], ridge)


def _freedom(result: Identification) -> int:
    """Number of readings minus unknowns, at least one."""
    problem = result.problem
    spent = problem.free.size + len(problem.linear)
    return max(int((problem.side == 0).sum()) - spent, 1)


def _scatter(result: Identification, noise: Noise) -> float:
    """Known noise, or else that of the best fit, clipped to its interval."""
    if not isinstance(noise, tuple):
        return noise
    problem = result.problem
    own = result.end.point.residual[: problem.force.size][problem.side == 0]
    found = float(np.sqrt(own @ own / _freedom(result)))
    low, high = np.log(noise)
    margin = 1e-3 * (high - low)
    return float(np.exp(np.clip(np.log(max(found, noise[0])), low + margin, high - margin)))


def _whitening(
    columns: Float[np.ndarray, "k n"], names: tuple[str, ...]
) -> Float[np.ndarray, "n n"]:
    """S such that the columns of (columns S) are orthonormal.

    Raises:
        InputError: readings and priors do not determine a coefficient.
    """
    if not columns.shape[1]:
        return np.zeros((0, 0))
    length = np.linalg.norm(columns, axis=0)
    R = np.linalg.qr(columns / np.where(length > 0, length, 1.0), mode="r")
    if not np.linalg.svd(R, compute_uv=False).min() > 1e-8:
        raise InputError(
            f"the readings do not determine {', '.join(dict.fromkeys(names))}, which have no posterior "
            "with a flat prior: give priors (parameters=, --prior), or use a lower order"
        )
    return np.linalg.inv(R) / length[:, None]
