"""The convex core on the host: least squares under linear inequalities, in NumPy.

    minimise 1/2 |A x - b|^2   subject to   G x >= h

The same method as `qp.solve_qp`, which is the driver for batches and for derivatives: columns are
scaled, rows compressed by A = Q R, and in y = R x the optimum is the point of a polyhedron nearest
to Q^T b, found by the dual active-set method of Goldfarb & Idnani. Only a programme whose rows are
violated there is solved by itself, in a tenth of a millisecond, and nothing is compiled.

References:
    Goldfarb & Idnani 1983, Mathematical Programming 27, 1-33.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from .status import Status

_EPS = float(np.finfo(float).eps)
_TINY = float(np.finfo(float).tiny)
_DEPENDENT = 1e-7  # part of a row of unit length that the others do not explain
_ROUNDS = 8  # in which the active rows of most problems are found
_PARALLEL = 1e4 * _EPS**1.5  # squared sine of an angle that is rounding


@dataclasses.dataclass(frozen=True)
class Optima:
    """The optima of quadratic programmes, with what their derivatives and certificates need.

    Of one programme the same without the leading axes; see `arrays.member`.

    Attributes:
        x: minimisers, shape (*b, n); nan unless `status` is OPTIMAL.
        rows: indices of the active rows, one array for each programme.
        multipliers: of the active rows, >= 0, likewise.
        inverse: R^-1 with A = Q R, shape (*b, n, n): x = inverse y.
        scale: lengths of the columns of A, 1 for an empty one, shape (*b, n).
        condition: |A| |A^+| in the Frobenius norm, of columns of unit length, shape (*b,).
        status: how each ended, a `Status`, shape (*b,).
    """

    x: Float[np.ndarray, "*b n"]
    rows: Any
    multipliers: Any
    inverse: Float[np.ndarray, "*b n n"]
    scale: Float[np.ndarray, "*b n"]
    condition: Float[np.ndarray, "*b"]
    status: Int[np.ndarray, "*b"]

    def certificate(
        self,
        A: Float[np.ndarray, "k n"],
        b: Float[np.ndarray, " k"],
        G: Float[np.ndarray, "m n"],
        h: Float[np.ndarray, " m"],
    ) -> tuple[float, float]:
        """Optimality of one programme as it was given, not of its compressed form.

        Returns:
            (largest violation of the optimality conditions relative to |b|, duality gap relative
            to the objective).
        """
        if self.status != Status.OPTIMAL:
            return np.nan, np.nan
        size = np.linalg.norm((G * 1.0) @ self.inverse, axis=1)
        size = np.where(size > 0, size, 1.0)
        residual, slack = A @ self.x - b, (G @ self.x - h) / size
        stationarity = (A.T @ residual - self.multipliers @ G[self.rows]) / self.scale
        weights = self.multipliers * size[self.rows]
        largest = max(
            np.abs(stationarity).max(initial=0.0),
            -slack.min(initial=0.0),
            -weights.min(initial=0.0),
        )
        excess = self.inverse.T @ (stationarity * self.scale)
        gap = weights @ slack[self.rows] + excess @ excess / 2
        objective, data = residual @ residual / 2, np.linalg.norm(b)
        return float(largest / max(data, _TINY)), float(
            abs(gap) / max(objective, _EPS * data**2 + _TINY)
        )

    def sensitivity(
        self,
        G: Float[np.ndarray, "b m n"],
        d_gradient: Float[np.ndarray, "b q n"],
        d_slack: Float[np.ndarray, "b m q"],
        dG_l: Float[np.ndarray, "b q n"],
    ) -> Float[np.ndarray, "b q n"]:
        """Dx along q directions, by the implicit function theorem on the active set.

        Args:
            G: constraint rows.
            d_gradient: dA^T r + A^T dr, the change of A^T r at constant x.
            d_slack: d(G x - h) at constant x.
            dG_l: dG^T l, l the multipliers of all rows.
        """
        right = (dG_l - d_gradient) @ self.inverse  # in y
        n, counts = right.shape[2], np.array([rows.size for rows in self.rows])
        for count in np.unique(counts[counts > 0]):
            here = np.flatnonzero(counts == count)
            rows = np.stack([self.rows[k] for k in here])
            N = G[here[:, None], rows] @ self.inverse[here]
            system = np.zeros((here.size, n + count, n + count))
            system[:, :n, :n] = np.eye(n)
            system[:, :n, n:], system[:, n:, :n] = -N.transpose(0, 2, 1), N
            both = np.concatenate(
                [right[here].transpose(0, 2, 1), -d_slack[here[:, None], rows]], 1
            )
            right[here] = np.linalg.solve(system, both)[:, :n].transpose(0, 2, 1)
        return right @ self.inverse.transpose(0, 2, 1)


def solve_host_qps(
    A: Float[np.ndarray, "b k n"],
    b: Float[np.ndarray, "b k"],
    G: Float[np.ndarray, "b m n"],
    h: Float[np.ndarray, "b m"],
    guesses: Sequence[np.ndarray | None] | None = None,
) -> Optima:
    """The minimisers of 1/2 |A x - b|^2 subject to G x >= h, of several programmes.

    Args:
        A: design matrices, any units per column, k >= n.
        b: data.
        G: constraint rows; a row of zeros with h <= 0 switches a constraint off.
        h: constraint offsets.
        guesses: active rows of neighbouring programmes, to start from.

    Returns:
        The optima.
    """
    count, k, n = A.shape
    squares = np.einsum("bkn,bkn->bn", A, A)
    scale = np.sqrt(squares)
    scale[~(scale > 0)] = 1.0
    # A sum that is finite has finite parts; which of them are not is asked where it is not.
    whole = bool(np.isfinite(squares.sum() + b.sum() + G.sum()))
    finite = np.full(count, whole)
    if not whole:
        finite = np.isfinite(b).all(axis=1)
        finite &= np.isfinite(A).all(axis=(1, 2)) & np.isfinite(G).all(axis=(1, 2))
    status = np.where(finite, Status.OPTIMAL, Status.STALLED)
    if n == 0:
        return Optima(
            np.zeros((count, 0)), [np.zeros(0, int)] * count, [np.zeros(0)] * count,
            np.zeros((count, 0, 0)), scale, np.ones(count), status,
        )  # fmt: skip
    unit = np.eye(n)
    scaled = A / scale[:, None]
    if not whole:
        scaled[~finite] = np.eye(k, n)
    Q, R = np.linalg.qr(scaled)
    norm = np.sqrt((R * R).sum(axis=(1, 2)))
    diagonal = np.abs(np.diagonal(R, axis1=1, axis2=2)).min(axis=1)
    regular = diagonal > _EPS * norm
    inverse = np.linalg.inv(np.where(regular[:, None, None], R, unit))
    condition = np.where(regular, norm * np.sqrt((inverse * inverse).sum(axis=(1, 2))), np.inf)
    condition[~finite] = np.nan
    poor = finite & ~(condition * 10 * max(k, n) * _EPS < 1)
    status[poor] = Status.RANK_DEFICIENT
    good = finite & ~poor
    inverse = inverse / scale[:, :, None]
    inverse[~good] = unit
    centre = (np.where(good[:, None], b, 0.0)[:, None] @ Q)[:, 0]
    offsets = np.where(good[:, None], h, -np.inf)
    y, rows, multipliers, walked = nearest_points(G, offsets, centre, inverse, guesses)
    status[good] = walked[good]
    x = (inverse @ y[:, :, None])[:, :, 0]
    x[status != Status.OPTIMAL] = np.nan
    return Optima(x, rows, multipliers, inverse, scale, condition, status)


def nearest_points(
    G: Float[np.ndarray, "b m n"],
    h: Float[np.ndarray, "b m"],
    centre: Float[np.ndarray, "b n"],
    J: Float[np.ndarray, "b n n"],
    guesses: Sequence[np.ndarray | None] | None = None,
) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray], np.ndarray]:
    """The points y nearest to `centre` with G J y >= h, of several polyhedra.

    Args:
        G: rows; those of zeros with h <= 0 are off.
        h: offsets.
        centre: the unconstrained optima.
        J: well-conditioned.
        guesses: active rows of neighbouring problems, to start from.

    Returns:
        (y, active rows, multipliers of the rows as they were given, status).
    """
    normals, y, count = G @ J, centre.copy(), len(G)
    rows, multipliers = [np.zeros(0, int)] * count, [np.zeros(0)] * count
    status = np.full(count, int(Status.OPTIMAL))
    size = np.sqrt(np.einsum("bmn,bmn->bm", normals, normals))
    size[size == 0] = 1.0
    normals, offsets = normals / size[:, :, None], h / size
    slack = (normals @ centre[:, :, None])[:, :, 0] - offsets
    noise = 32 * _EPS * (np.linalg.norm(centre, axis=1)[:, None] + np.abs(offsets))
    bound = np.flatnonzero((slack < -noise).any(axis=1))
    known = None if guesses is None else [guesses[one] for one in bound.tolist()]
    together = _on_guessed_faces(
        normals[bound],
        offsets[bound],
        centre[bound],
        slack[bound] + noise[bound],
        noise[bound],
        known,
    )
    for place, one in enumerate(bound.tolist()):
        if place in together:
            y[one], rows[one], found = together[place]
        else:
            guess = None if known is None else known[place]
            y[one], rows[one], found, status[one] = _nearest_point(
                normals[one], offsets[one], centre[one], guess
            )
        multipliers[one] = found / size[one, rows[one]]
    return y, rows, multipliers, status


def _on_guessed_faces(
    G: Float[np.ndarray, "b m n"],
    h: Float[np.ndarray, "b m"],
    centre: Float[np.ndarray, "b n"],
    slack: Float[np.ndarray, "b m"],
    noise: Float[np.ndarray, "b m"],
    guesses: Sequence[np.ndarray | None] | None,
) -> dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """`_nearest_point` of those whose active rows are found in a few rounds, all of them together.

    Each round solves every problem on the face of some rows, then drops the rows that would pull
    and adds the one that is violated most. What satisfies all conditions is the optimum, however its
    face was guessed. Without a guess the row of the lowest slack is the first. Violations below `noise`
    count as rounding.

    Returns:
        (y, active rows, their multipliers) by place; the others are left to `_nearest_point`.
    """
    found: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    left, n = np.arange(len(centre)), centre.shape[1]
    active = np.zeros(slack.shape, bool)
    for place in left.tolist():
        guess = None if guesses is None else guesses[place]
        given = guess is not None and 0 < guess.size <= n
        active[place, guess if given else np.argmin(slack[place])] = True
    for _ in range(_ROUNDS):
        counts, going = active[left].sum(axis=1), []
        for count in np.unique(counts[(counts > 0) & (counts <= n)]).tolist():
            here = left[counts == count]
            rows = np.nonzero(active[here])[1].reshape(-1, count)
            N = G[here[:, None], rows]
            Q, R = np.linalg.qr(N.transpose(0, 2, 1))
            regular = np.abs(np.diagonal(R, axis1=1, axis2=2)).min(axis=1) > _DEPENDENT
            here, rows, N, Q, R = (leaf[regular] for leaf in (here, rows, N, Q, R))
            c = centre[here]
            short = h[here[:, None], rows] - (N @ c[:, :, None])[:, :, 0]
            along = np.linalg.solve(R.transpose(0, 2, 1), short[:, :, None])
            y = c + (Q @ along)[:, :, 0]
            multipliers = np.linalg.solve(R, along)[:, :, 0]
            over = (G[here] @ y[:, :, None])[:, :, 0] - h[here] + noise[here]
            over[np.arange(here.size)[:, None], rows] = 0.0
            worst, pulls = over.argmin(axis=1), multipliers < 0
            violated = over[np.arange(here.size), worst] < 0
            done = ~violated & ~pulls.any(axis=1)
            for k in np.flatnonzero(done).tolist():
                found[int(here[k])] = y[k], rows[k], multipliers[k]
            active[here[:, None], rows] = ~pulls
            active[here[violated], worst[violated]] = True
            going.append(here[~done])
        left = np.sort(np.concatenate(going)) if going else left[:0]
        if not left.size:
            break
    return found


def _nearest_point(
    G: Float[np.ndarray, "m n"],
    h: Float[np.ndarray, " m"],
    centre: Float[np.ndarray, " n"],
    guess: Int[np.ndarray, " a"] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Status]:
    """One of `nearest_points`, for rows of unit length: y, active rows, their multipliers, status."""
    n = centre.size
    noise = 32 * _EPS * (np.linalg.norm(centre) + np.abs(h))
    active: list[int] = []
    multipliers = np.zeros(0)
    y = centre
    if guess is not None and 0 < guess.size <= n:
        warm = _on_face(G[guess], h[guess], centre)
        if warm is not None and (warm[1] >= 0).all():
            y, multipliers, active = *warm, list(guess)
    for _ in range(20 * n + 20):
        slack = G @ y - h
        if not slack.size or not (slack < -noise).any():
            break
        entering = int(np.argmin(slack))
        if slack[entering] >= -noise[entering]:
            entering = int(np.argmin(slack + noise))
        normal, share_of_row = G[entering], 0.0
        while True:
            N = G[active]
            shares = np.zeros(0)
            direction = normal
            if active:
                shares = np.linalg.lstsq(N.T, normal, rcond=None)[0]
                direction = normal - shares @ N
            square = direction @ normal
            independent = square > max(_PARALLEL, 1e-14) and len(active) < n
            full = (h[entering] - normal @ y) / square if independent else np.inf
            blocks = shares > _EPS
            ratios = np.where(blocks, multipliers / np.where(blocks, shares, 1.0), np.inf)
            leaving = int(np.argmin(ratios)) if ratios.size else -1
            partial = ratios[leaving] if ratios.size else np.inf
            step = min(full, partial)
            if not np.isfinite(step):
                return y, np.array(active, int), multipliers, Status.INFEASIBLE
            multipliers = multipliers - step * shares
            share_of_row += step
            if independent:
                y = y + step * direction
            if full <= partial:
                active.append(entering)
                multipliers = np.append(multipliers, share_of_row)
                break
            del active[leaving]
            multipliers = np.delete(multipliers, leaving)
        exact = _on_face(G[active], h[active], centre)
        if exact is not None:
            y, multipliers = exact
    else:
        return y, np.array(active, int), multipliers, Status.STALLED
    return y, np.array(active, int), np.maximum(multipliers, 0.0), Status.OPTIMAL


def _on_face(
    N: Float[np.ndarray, "a n"], offsets: Float[np.ndarray, " a"], centre: Float[np.ndarray, " n"]
) -> tuple[np.ndarray, np.ndarray] | None:
    """The solution of y - N^T l = c, N y = h; None where the rows are dependent."""
    if not len(N):
        return centre, np.zeros(0)
    Q, R = np.linalg.qr(N.T)
    if np.abs(np.diagonal(R)).min() <= _DEPENDENT:
        return None
    along = np.linalg.solve(R.T, offsets - N @ centre)
    return centre + Q @ along, np.linalg.solve(R, along)
