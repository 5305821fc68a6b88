"""The density of the posterior of an identification; coefficients are integrated where they are normal.

Readings y = F(u) + C(u) x + noise, u in a box, x with a flat prior, or a normal one, on the set that
the constraint leaves. For a given u and noise the coefficients are normal but for the constraint:
p(y | u) is the normal's mass, exp(-r^2/2) / det(Q)^1/2 with Q = A^T A of the weighted columns. What
of a constraint is active at the optimum, its faces, has slacks s = N x - h that are sampled, s >= 0,
with the normal density of s in the place of the rest of the mass. Censored readings leave nothing
normal: there the coefficients are sampled themselves.

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

from .convex import cholesky, inverse_lower
from .engine import Point
from .problem import Problem, PureProblem
from .result import Identification
from .search import descend_many
from .summary import joint_derivatives

_INSIDE = 3.0  # standard deviations from a bound that do not feel it


class BoxMap(eqx.Module):
    """A smooth bijection of R^d and the inside of a box; a truncated normal in it is nearly a standard one.

    Coordinate by coordinate, with t standardised by what is known of a quadratic model,

        v_j = c_j + w_j t_j,   c_j = mean_j + sum_{i<j} L_ji t_i,   w_j = L_jj
        sigma(t_j) = (1 - p) sigma(-alpha_j) + p sigma(beta_j),   p = sigma(z_j)

    where sigma is the logistic function and [-alpha_j, beta_j] what the box leaves of t_j. Far from the
    bounds t = z; at a bound it is the logit of the distance. The ridge of two parameters, of which one
    lies on its bound, becomes a straight one, of unit width. Where it is curved, c_j follows a cubic in
    the first coordinate, which leads. Every array is in the map's own order.

    Attributes:
        order: place in the box of each coordinate of the map, shape (d,).
        low, high: the box, shape (d,).
        mean: of the quadratic model, inside the box or not, shape (d,).
        root: its lower triangle L, L L^T the covariance, shape (d, d).
        curve: c_j as a polynomial in t_0, rising powers, but for the terms of others, shape (d, 4).
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
        """The map of a box and a quadratic model; what its bounds cut off most leads."""
        std = np.sqrt(np.diag(covariance))
        inside = np.minimum(np.minimum(mean - low, high - mean) / std, _INSIDE)
        order = np.lexsort((-std / (high - low), inside))
        root = np.linalg.cholesky(covariance[np.ix_(order, order)])
        curve = np.zeros((low.size, 4))
        curve[:, 0], curve[1:, 1] = mean[order], root[1:, 0]
        return cls(order, low[order], high[order], mean[order], root, curve)

    def along(self, leads: Float[np.ndarray, " k"], ridge: dict[int, np.ndarray]) -> "BoxMap":
        """The same map with centres that follow a ridge.

        Args:
            leads: values of the coordinate that leads, at least two.
            ridge: by place in the box, where the centre of another is at each of them.
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
        """The point of the box, and log |dv/dz|."""
        log_slope, t, v = jnp.zeros(()), [], []
        for j in range(z.shape[0]):
            root = jnp.asarray(self.root[j])
            width, curve = root[j], jnp.asarray(self.curve[j])
            centre = curve[0]
            if j:
                centre = centre + t[0] * (curve[1] + t[0] * (curve[2] + t[0] * curve[3]))
            centre = centre + sum((root[i] * t[i] for i in range(1, j)), start=jnp.zeros(()))
            t_j, slope = _within(
                (centre - self.low[j]) / width, (self.high[j] - centre) / width, z[j]
            )
            log_slope = log_slope + jnp.log(width) + slope
            t.append(t_j)
            v.append(centre + width * t_j)
        return jnp.zeros_like(z).at[jnp.asarray(self.order)].set(jnp.stack(v)), log_slope


def _within(alpha: Array, beta: Array, z: Array) -> tuple[Array, Array]:
    """T in (-alpha, beta), and log dt/dz; sums of positive numbers by their logarithms."""
    log = jax.nn.log_sigmoid
    up, down = log(z), log(-z)
    below = jnp.logaddexp(log(-alpha) + down, log(beta) + up)
    above = jnp.logaddexp(log(alpha) + down, log(-beta) + up)
    # sigma(beta) - sigma(-alpha), without a difference of numbers that are nearly the same
    span = log(alpha) + log(beta) + jnp.log(-jnp.expm1(-(alpha + beta)))
    return below - above, span + up + down - below - above


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
    problem: Problem, point: Point, scale: Float[np.ndarray, "n n"], spread: Float[np.ndarray, " m"]
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
    both = zip(problem.parts, faces.stations, strict=True)
    return dataclasses.replace(
        problem, parts=tuple(part.with_stations(stations) for part, stations in both)
    )


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


class Layout(eqx.Module):
    """What the sampled vector v holds: geometry, log of the noise, slacks, coefficients.

    Attributes:
        geometry: number of parameters in the unit box.
        noise: whether the noise is sampled.
        slacks: places of the faces among the rows of the constraint.
        held: places of rows that are equations: the bounds of coefficients that are held.
        joint: whether the coefficients are sampled and not integrated.
    """

    geometry: int = eqx.field(static=True)
    noise: bool = eqx.field(static=True)
    slacks: tuple[int, ...] = eqx.field(static=True)
    held: tuple[int, ...] = eqx.field(static=True)
    joint: bool = eqx.field(static=True)


class Coordinates(eqx.Module):
    """Coefficients x = centre + scale c, in which they are about a standard normal.

    Attributes:
        centre: shape (n,).
        scale: shape (n, n).
        face_scale: of the rows of faces and held coefficients [Pa], shape (r,).
        others: rows on c that these leave open at the optimum, shape (n - r, n).
    """

    centre: Float[np.ndarray, " n"]
    scale: Float[np.ndarray, "n n"]
    face_scale: Float[np.ndarray, " r"]
    others: Float[np.ndarray, "o n"]


class Density(eqx.Module):
    """The logarithm of the posterior, of points z of R^d.

    Attributes:
        fit: the problem, its constraint posed at the faces alone.
        force: readings [N]; where one is censored, its limit.
        side: 0 for a reading, 1 where the force is at most the limit, -1 where it is at least.
        layout, coordinates: of the sampled vector.
        noise: standard deviation, in the unit of a weighted residual, where it is known.
        prior_noise: against which the rows of priors were weighed.
        box: of v.
    """

    fit: PureProblem
    force: Float[np.ndarray, " points"]
    side: Int[np.ndarray, " points"]
    layout: Layout
    coordinates: Coordinates
    noise: Float[np.ndarray, ""]
    prior_noise: Float[np.ndarray, ""]
    box: BoxMap

    def __call__(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log p(v | y) + log |dv/dz|, but for a constant."""
        v, log_slope = self.box(z)
        return self.log_posterior(v) + log_slope

    def parts(self, v: Float[Array, " d"]) -> tuple[Array, Array, Array, Array]:
        """Geometry in the unit box, noise, slacks in their scale, other coefficients."""
        p, r = self.layout.geometry, len(self.layout.slacks)
        first = p + self.layout.noise
        sigma = jnp.exp(v[p]) if self.layout.noise else jnp.asarray(self.noise)
        slack = jnp.concatenate([v[first : first + r], jnp.zeros(len(self.layout.held))])
        return v[:p], sigma, slack, v[first + r :]

    def log_posterior(self, v: Float[Array, " d"]) -> Float[Array, ""]:
        """Log p(v | y), but for a constant."""
        u, sigma, slack, rest = self.parts(v)
        p = self.fit.parameters(u)
        A, b, N, offset = self._programme(p, sigma)
        measured = jnp.sum(jnp.asarray(self.side == 0))
        found = -measured * jnp.log(sigma) - jnp.sum(self._prior(p) ** 2) / 2
        if self.layout.joint:
            c, log_volume = self._coefficients(N, offset, slack, rest)
            return found + log_volume + self._log_likelihood(A @ c - b, p, c, sigma)
        lower, inverse, middle = _normal(A, b)
        r = A @ middle - b
        found = found - r @ r / 2 - jnp.sum(jnp.log(jnp.diagonal(lower)))
        if slack.size:
            # The density of the slacks: that of N c - offset, c normal.
            half = N @ inverse.T
            spread = cholesky(half @ half.T)
            away = inverse_lower(spread) @ (slack - (N @ middle - offset))
            found = found - away @ away / 2 - jnp.sum(jnp.log(jnp.diagonal(spread)))
        return found

    def draw(
        self, whole: PureProblem, v: Float[Array, " d"], key: Array
    ) -> tuple[Float[Array, " q"], Float[Array, " n"], Float[Array, ""], Bool[Array, ""]]:
        """One draw of everything: parameters [SI], coefficients, noise, and whether it may be.

        Args:
            whole: the problem, its constraint posed everywhere.
            v: of the sampled vector.
            key: of the draw of the coefficients.
        """
        u, sigma, slack, rest = self.parts(v)
        p = self.fit.parameters(u)
        A, b, N, offset = self._programme(p, sigma)
        if self.layout.joint:
            c, _ = self._coefficients(N, offset, slack, rest)
        else:
            _, inverse, middle = _normal(A, b)
            c = middle + inverse.T @ jax.random.normal(key, middle.shape)
            if slack.size:
                half = N @ inverse.T
                back = jnp.linalg.solve(half @ half.T, slack - (N @ c - offset))
                c = c + inverse.T @ (half.T @ back)
        x = jnp.asarray(self.coordinates.centre + self.coordinates.scale @ c)
        _, _, G, h = self._posed(whole, p)
        rounding = 1e-9 * jnp.max(jnp.abs(x), initial=0.0)
        held = jnp.min(G @ x - h, initial=jnp.inf) >= -rounding
        return p, x, sigma, held & jnp.all(jnp.isfinite(x))

    def _posed(self, of: PureProblem, p: Array) -> tuple[Array, Array, Array, Array]:
        """A, b, G and h about no coefficients, every reading with the weight that it has."""
        force = jnp.asarray(self.force)
        none = jnp.zeros(self.coordinates.centre.shape)
        return of.programme(p, none, force, jnp.ones(force.shape), force)

    def _programme(self, p: Array, sigma: Array) -> tuple[Array, Array, Array, Array]:
        """A, b of the standardised residual A c - b, and N, offset of the slacks N c - offset."""
        of, count = self.coordinates, self.force.shape[0]
        A, b, G, h = self._posed(self.fit, p)
        scale = jnp.where(jnp.arange(A.shape[0]) < count, 1 / sigma, 1 / self.prior_noise)
        at = np.array(self.layout.slacks + self.layout.held, int)
        N, h = (leaf / (of.face_scale[:, None] if leaf.ndim == 2 else of.face_scale)
                for leaf in (G[at], h[at]))  # fmt: skip
        b = scale * (b - A @ of.centre)
        return scale[:, None] * (A @ of.scale), b, jnp.asarray(N @ of.scale), h - N @ of.centre

    def _prior(self, p: Array) -> Array:
        rows, means = self.fit.priors
        return jnp.asarray((rows @ p - means) / self.prior_noise)

    def _coefficients(
        self, N: Array, offset: Array, slack: Array, rest: Array
    ) -> tuple[Array, Array]:
        """The coefficients of slacks and others, and the logarithm of the volume they stand for."""
        if not slack.size:
            return jnp.asarray(self.coordinates.others.T @ rest), jnp.zeros(())
        rows = jnp.concatenate([N, jnp.asarray(self.coordinates.others)])
        c = jnp.linalg.solve(rows, jnp.concatenate([slack + offset, rest]))
        return c, -jnp.linalg.slogdet(rows)[1]

    def _log_likelihood(self, residual: Array, p: Array, c: Array, sigma: Array) -> Array:
        """Of readings and priors, but for the determinant of the noise."""
        count = self.force.shape[0]
        if self.fit.compliant:
            x = jnp.asarray(self.coordinates.centre + self.coordinates.scale @ c)
            exact, _ = self.fit.exact(p, x, jnp.asarray(self.force), jnp.asarray(self.force))
            residual = jnp.concatenate([exact[:count] / sigma, residual[count:]])
        priors, r, side = residual[count:], residual[:count], jnp.asarray(self.side)
        censored = log_ndtr(jnp.where(side == 0, 0.0, -side * r))
        return jnp.sum(jnp.where(side == 0, -(r**2) / 2, censored)) - priors @ priors / 2


def _normal(A: Array, b: Array) -> tuple[Array, Array, Array]:
    """Lower triangle of A^T A, its inverse, and the coefficients of the least residual."""
    lower = cholesky(A.T @ A)
    inverse = inverse_lower(lower)
    return lower, inverse, inverse.T @ (inverse @ (A.T @ b))


Noise = float | tuple[float, float]
"""Standard deviation of a reading where it is known, or the ends of its interval."""

_UNIFORM = 12.0  # 1 / variance of a uniform distribution in the unit box
_HELD = 1e12  # the same of the slack of a held coefficient, which is zero
_SINGULAR = 1e-8  # smallest singular value of columns of unit length that determine coefficients
_REACH, _NODES, _EXCESS = 4.0, 13, 10.0  # of a ridge: standard deviations, optima, log-likelihood
_INNER = 1e-3  # of the interval of the noise: the optimum is no nearer to its ends
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
    slope, slack = (slope[faces.rows], (point.G @ point.x - point.h)[faces.rows])
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
        raise InputError("there is nothing to sample: every parameter is held")
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
    result: Identification, box: BoxMap, sigma: float, on_x: Float[np.ndarray, "o n"]
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
    margin = _INNER * (high - low)
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
