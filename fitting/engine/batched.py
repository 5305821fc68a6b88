"""The second driver of a fit: the same problem in JAX, for batches and for derivatives through it.

One fit is solved on the host, see `descent`. Thousands of them are one `jit(vmap(...))`, and a fit
inside a larger computation has to be differentiable: both are made here of the same linear model
(`program.response`), the same convex core and the same outer search, and agree with the host.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..convex.qp import Optimum, solve_qp
from .box import minimise_in_box
from .family import AbstractFamily
from .problem import Problem
from .response import Constraint, MapInputs, force_and_constraint, response

_REACHES = 6  # linear models of a compliant rig: quadratic convergence
_EXACT = 2  # Newton steps of a compliant rig at its solution: exact to second derivatives
_HELD = 1e-9  # of the box: a parameter this near to a bound is on it


class _Part(eqx.Module):
    """One force map; readings [N], weights and places as in `problem.Part`."""

    family: AbstractFamily
    inputs: MapInputs
    weight: Float[Array | np.ndarray, " points"]
    at: Int[np.ndarray, " q"]
    coefficients: Int[np.ndarray, " n"]
    rig: tuple[int, ...] = eqx.field(static=True)


class BatchedFit(eqx.Module):
    """Where fits ended; leading axes of a batch.

    Attributes:
        parameters: nonlinear ones [SI], shape (q,).
        x: coefficients [Pa], shape (n,).
        cost: half the weighted sum of squares, priors included.
        converged: whether the end is stationary.
    """

    parameters: Float[Array, "*batch q"]
    x: Float[Array, "*batch n"]
    cost: Float[Array, "*batch"]
    converged: Bool[Array, "*batch"]


class Batched(eqx.Module):
    """A problem as pure functions of the forces that were read.

    Attributes:
        parts: one for each force map.
        low, high: bounds of the nonlinear parameters [SI], shape (q,).
        free: places of those that may move.
        limits: rows and offsets of the bounds on the coefficients, G x >= h.
        prior_rows: rows and targets of priors on coefficients, weighted.
        priors: places, means and weights of priors on nonlinear parameters.
        constraint: on the coefficients.
        ridge: see `Problem`.
        censored: whether readings count on one side only, which the host's fit alone knows.
    """

    parts: tuple[_Part, ...]
    low: Float[Array | np.ndarray, " q"]
    high: Float[Array | np.ndarray, " q"]
    free: tuple[int, ...] = eqx.field(static=True)
    limits: tuple[Float[Array | np.ndarray, "m n"], Float[Array | np.ndarray, " m"]]
    prior_rows: tuple[Float[Array | np.ndarray, "k n"], Float[Array | np.ndarray, " k"]]
    priors: tuple[
        Int[Array | np.ndarray, " r"],
        Float[Array | np.ndarray, " r"],
        Float[Array | np.ndarray, " r"],
    ]
    constraint: Constraint = eqx.field(static=True)
    ridge: float = eqx.field(static=True)
    censored: bool = eqx.field(static=True)

    @classmethod
    def of(cls, problem: Problem) -> "Batched":
        """The problem that the host solves, as it is."""
        n, unit = len(problem.linear), np.eye(len(problem.linear))
        lowest = problem.lowest
        low_on, high_on = np.isfinite(lowest), np.isfinite(problem.coefficient_max)
        known = problem.coefficient_priors
        scale = np.array([problem.noise / p.std for p in known])
        priors = problem.priors
        return cls(
            parts=tuple(
                _Part(p.family, p.inputs, p.weight, p.at, p.coefficients, p.rig)
                for p in problem.parts
            ),
            low=problem.low,
            high=problem.high,
            free=tuple(problem.free.tolist()),
            limits=(
                np.concatenate([unit[low_on], -unit[high_on]]),
                np.concatenate([lowest[low_on], -problem.coefficient_max[high_on]]),
            ),
            prior_rows=(
                scale[:, None] * unit[[p.place for p in known]].reshape(len(known), n),
                scale * np.array([p.mean for p in known]),
            ),
            priors=(
                np.array([p.place for p in priors], int),
                np.array([p.mean for p in priors], float),
                np.array([problem.noise / p.std for p in priors], float),
            ),
            constraint=problem.constraint,
            ridge=problem.ridge,
            censored=bool(problem.side.any()),
        )

    def parameters(self, u: Float[Array, " p"]) -> Float[Array, " q"]:
        """The parameters [SI] at a point of the unit box."""
        at = jnp.asarray(self.free, int)
        low = jnp.asarray(self.low)
        return low.at[at].add(u * (self.high - low)[at])

    def descend(
        self,
        force: Float[Array, " points"],
        factor: Float[Array, " points"],
        start: Float[Array, " p"],
    ) -> BatchedFit:
        """The fit to forces [N] with factors on their weights, from a point of the unit box.

        Raises:
            ValueError: some of the readings are censored.
        """
        if self.censored:
            raise ValueError(
                "a fit in JAX takes every reading for what it says; this problem has censored ones, "
                "which count on one side only. Solve it on the host, by `fitting.identify`"
            )

        def residual(u: Float[Array, " p"]) -> Float[Array, " k"]:
            p = self.parameters(u)
            optimum, x0, reached = self._solve(p, force, factor)
            A, b, _, _ = self.programme(p, x0, force, factor, reached)
            return self._with_priors(p, A @ optimum.x - b)

        end = minimise_in_box(residual, start)
        p = self.parameters(end.u)
        return BatchedFit(p, self._solve(p, force, factor)[0].x, end.cost, end.converged)

    def differentiable(
        self, force: Float[Array, " points"], start: Float[Array, " p"]
    ) -> BatchedFit:
        """The same fit, whose parameters and coefficients may be differentiated in the forces.

        The search itself is not differentiated: a last Newton step on the optimality conditions,
        with parameters on a bound and active rows held, has the derivative of the optimum.
        """
        ones = jnp.ones_like(force)
        near = jax.lax.stop_gradient(self.descend(force, ones, start))
        optimum, _, reached = jax.lax.stop_gradient(self._solve(near.parameters, force, ones))
        at, q = jnp.asarray(self.free, int), len(self.free)
        width = (jnp.asarray(self.high) - self.low)[at]
        u = (near.parameters - self.low)[at] / width
        moves = jnp.concatenate([(u > _HELD) & (u < 1 - _HELD), jnp.ones(near.x.shape, bool)])
        size = jnp.maximum(jnp.abs(near.x), jnp.max(jnp.abs(near.x)) * 1e-6 + 1e-300)

        def both(z: Float[Array, " z"]) -> tuple[Array, Array]:
            p, x = self.parameters(z[:q]), z[q:] * size
            residual, slack = self.exact(p, x, force, reached)
            return residual @ residual / 2, jnp.where(optimum.active, slack, 0.0)

        def lagrangian(z: Float[Array, " z"]) -> Float[Array, ""]:
            cost, slack = both(z)
            return cost - optimum.multipliers @ slack

        z = jnp.concatenate([u, near.x / size])
        gradient, curvature = jax.grad(lagrangian)(z), jax.hessian(lagrangian)(z)
        slack, rows = both(z)[1], jax.jacfwd(lambda z: both(z)[1])(z)
        gradient = jnp.where(moves, gradient, 0.0)
        H = jnp.where(moves[:, None] & moves, curvature, jnp.eye(z.size))
        N = jnp.where(moves, rows, 0.0)
        off = jnp.diag(jnp.where(optimum.active, 0.0, 1.0))
        system = jax.lax.stop_gradient(jnp.block([[H, -N.T], [N, off]]))
        step = jnp.linalg.solve(system, -jnp.concatenate([gradient, slack]))[: z.size]
        z = z + step
        return BatchedFit(self.parameters(z[:q]), z[q:] * size, near.cost, near.converged)

    def _solve(
        self, p: Float[Array, " q"], force: Float[Array, " points"], factor: Float[Array, " points"]
    ) -> tuple[Optimum, Float[Array, " n"], Float[Array, " points"]]:
        """The convex fit at given parameters, and the coefficients and forces it is linear about."""
        x0, reached = jnp.zeros(self.limits[0].shape[1]), force
        if not any(part.rig for part in self.parts):
            return self._convex(*self.programme(p, x0, force, factor, force)), x0, force
        fixed = jax.lax.stop_gradient(p)

        def refit(_: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
            x = self._convex(*self.programme(fixed, state[0], force, factor, state[1])).x
            ones = jnp.ones_like(force)
            A, b, _, _ = self.programme(fixed, state[0], force, ones, state[1])
            points = slice(force.shape[0])
            weight = jnp.concatenate([jnp.asarray(part.weight) for part in self.parts])
            return x, (A[points] @ x - b[points]) / weight + force

        x0, reached = jax.lax.stop_gradient(jax.lax.fori_loop(0, _REACHES, refit, (x0, reached)))
        return self._convex(*self.programme(p, x0, force, factor, reached)), x0, reached

    def _convex(self, A: Array, b: Array, G: Array, h: Array) -> Optimum:
        if self.ridge:
            size = jnp.linalg.norm(A, axis=0)
            A = jnp.concatenate([A, self.ridge * jnp.diag(jnp.where(size > 0, size, 1.0))])
            b = jnp.concatenate([b, jnp.zeros(A.shape[1])])
        return solve_qp(A, b, G, h)

    def programme(
        self,
        p: Float[Array, " q"],
        x0: Float[Array, " n"],
        force: Float[Array, " points"],
        factor: Float[Array, " points"],
        reached: Float[Array, " points"],
    ) -> tuple[Array, Array, Array, Array]:
        """A, b, G and h of the convex programme, as `Problem` poses it."""
        n, first = x0.shape[0], 0
        blocks: list[tuple[Any, ...]] = []
        for part in self.parts:
            here = slice(first, first + part.weight.shape[0])
            first = here.stop
            own = x0[part.coefficients]
            found, aside = response(
                part.family, self.constraint, part.inputs, p[part.at], own, reached[here]
            )
            offset, columns = found.force - found.columns @ own, found.columns
            if part.rig:
                gain = jax.lax.stop_gradient(aside.gain)
                offset = reached[here] + gain * (offset - reached[here])
                columns = gain[:, None] * columns
            weight = part.weight * factor[here]
            A = jnp.zeros((first - here.start, n)).at[:, part.coefficients].set(columns)
            rows = found.rows.reshape(-1, own.shape[0])
            G = jnp.zeros((rows.shape[0], n)).at[:, part.coefficients].set(rows)
            blocks.append(
                (
                    weight[:, None] * A,
                    weight * (force[here] - offset),
                    G,
                    rows @ own - found.values.ravel(),
                )
            )
        A, b, G, h = (jnp.concatenate(leaves) for leaves in zip(*blocks, strict=True))
        return (
            jnp.concatenate([A, self.prior_rows[0]]),
            jnp.concatenate([b, self.prior_rows[1]]),
            jnp.concatenate([G, self.limits[0]]),
            jnp.concatenate([h, self.limits[1]]),
        )

    def exact(
        self,
        p: Float[Array, " q"],
        x: Float[Array, " n"],
        force: Float[Array, " points"],
        reached: Float[Array, " points"],
    ) -> tuple[Float[Array, " k"], Float[Array, " m"]]:
        """Weighted residual and slack of every row, with nothing made linear."""
        first, residuals, values = 0, [], []
        for part in self.parts:
            here = slice(first, first + part.weight.shape[0])
            first = here.stop
            at = part.inputs
            if part.rig:
                at = eqx.tree_at(lambda m: m.force, at, reached[here])
            model, constraint = force_and_constraint(
                part.family, self.constraint, at, p[part.at], x[part.coefficients], _EXACT
            )
            residuals.append(part.weight * (model - force[here]))
            values.append(constraint)
        rows, targets = self.prior_rows
        G, h = self.limits
        residual = jnp.concatenate([*residuals, rows @ x - targets])
        return self._with_priors(p, residual), jnp.concatenate([*values, G @ x - h])

    def _with_priors(self, p: Float[Array, " q"], residual: Float[Array, " k"]) -> Array:
        places, means, weights = self.priors
        return jnp.concatenate([residual, weights * (p[places] - means)])
