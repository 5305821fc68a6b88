"""A problem as pure JAX functions: for posteriors, and for whoever differentiates through a fit.

`fitting.identify` finds the optimum; what is here is made of the same linear models and the same
convex core, and may be jitted, vmapped and differentiated.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .convex import AnyArray, solve_qp
from .engine import Point
from .problem import Problem
from .response import (
    AbstractFamily,
    Constraint,
    MapInputs,
    force_and_constraint,
    linear_response,
)

_EXACT = 2  # Newton steps of a compliant rig at its solution: exact to second derivatives
_HELD = 1e-9  # of the box: a parameter this near to a bound is on it


class _Part(eqx.Module):
    """One force map; readings [N], weights and places as in `problem.Part`."""

    family: AbstractFamily
    inputs: MapInputs
    weight: Float[AnyArray, " points"]
    at: Int[np.ndarray, " q"]
    coefficients: Int[np.ndarray, " n"]


class Optimised(eqx.Module):
    """An optimum that may be differentiated in the forces.

    Attributes:
        parameters: nonlinear ones [SI], shape (q,).
        x: coefficients [Pa], shape (n,).
    """

    parameters: Float[Array, " q"]
    x: Float[Array, " n"]


class PureProblem(eqx.Module):
    """A problem as pure functions of parameters and of the forces that were read.

    Attributes:
        parts: one for each force map.
        low, high: bounds of the nonlinear parameters [SI], shape (q,).
        free: places of those that may move.
        limits: rows and offsets of the bounds on the coefficients, G x >= h; zeros for none.
        prior_rows: rows and targets of priors on coefficients, weighted.
        priors: places, means and weights of priors on nonlinear parameters.
        constraint: on the coefficients.
        compliant: whether a rig gives way.
    """

    parts: tuple[_Part, ...]
    low: Float[AnyArray, " q"]
    high: Float[AnyArray, " q"]
    free: tuple[int, ...] = eqx.field(static=True)
    limits: tuple[Float[AnyArray, "m n"], Float[AnyArray, " m"]]
    prior_rows: tuple[Float[AnyArray, "k n"], Float[AnyArray, " k"]]
    priors: tuple[
        Int[AnyArray, " r"],
        Float[AnyArray, " r"],
        Float[AnyArray, " r"],
    ]
    constraint: Constraint = eqx.field(static=True)
    compliant: bool = eqx.field(static=True)

    @classmethod
    def of(cls, problem: Problem) -> "PureProblem":
        """The problem of an identification."""
        n, unit = len(problem.linear), np.eye(len(problem.linear))
        low_on, high_on = np.isfinite(problem.lowest), np.isfinite(problem.coefficient_max)
        known, priors = problem.coefficient_priors, problem.priors
        scale = np.array([problem.noise / p.std for p in known])
        return cls(
            parts=tuple(
                _Part(p.family, p.inputs, p.weight, p.at, p.coefficients) for p in problem.parts
            ),
            low=problem.low,
            high=problem.high,
            free=tuple(problem.free.tolist()),
            limits=(
                np.concatenate([unit * low_on[:, None], -unit * high_on[:, None]]),
                np.concatenate(
                    [
                        np.where(low_on, problem.lowest, -1.0),
                        np.where(high_on, -problem.coefficient_max, -1.0),
                    ]
                ),
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
            compliant=any(part.rig for part in problem.parts),
        )

    def parameters(self, u: Float[Array, " p"]) -> Float[Array, " q"]:
        """The parameters [SI] at a point of the unit box."""
        at = jnp.asarray(self.free, int)
        low = jnp.asarray(self.low)
        return low.at[at].add(u * (self.high - low)[at])

    def coefficients(
        self, p: Float[Array, " q"], force: Float[Array, " points"]
    ) -> Float[Array, " n"]:
        """The coefficients of the certified convex fit at given parameters [SI], in a rigid rig."""
        none = jnp.zeros(self.limits[0].shape[1])
        return solve_qp(*self.programme(p, none, force, jnp.ones_like(force), force)).x

    def programme(
        self,
        p: Float[Array, " q"],
        x0: Float[Array, " n"],
        force: Float[Array, " points"],
        factor: Float[Array, " points"],
        reached: Float[Array, " points"],
    ) -> tuple[Array, Array, Array, Array]:
        """A, b, G and h of the convex programme.

        Args:
            p: parameters [SI].
            x0: coefficients about which a compliant rig is made linear.
            force: that was read [N].
            factor: on the weights of the readings.
            reached: force [N] about which a compliant rig is made linear.
        """
        n, first = x0.shape[0], 0
        blocks: list[tuple[Array, ...]] = []
        for part in self.parts:
            here = slice(first, first + part.weight.shape[0])
            first = here.stop
            found = linear_response(
                part.family, self.constraint, part.inputs, p[part.at], x0[part.coefficients],
                reached[here],
            )  # fmt: skip
            weight = part.weight * factor[here]
            A = jnp.zeros((weight.shape[0], n)).at[:, part.coefficients].set(found.columns)
            G = jnp.zeros((found.rows.shape[0], n)).at[:, part.coefficients].set(found.rows)
            target = weight * (force[here] - found.force)
            blocks.append((weight[:, None] * A, target, G, -found.values))
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
            if self.compliant:
                at = eqx.tree_at(lambda m: m.force, at, reached[here])
            model, constraint = force_and_constraint(
                part.family, self.constraint, at, p[part.at], x[part.coefficients], _EXACT
            )
            residuals.append(part.weight * (model - force[here]))
            values.append(constraint)
        rows, targets = self.prior_rows
        G, h = self.limits
        places, means, weights = self.priors
        residuals += [rows @ x - targets, jnp.asarray(weights * (p[places] - means))]
        return jnp.concatenate(residuals), jnp.concatenate([*values, G @ x - h])

    def differentiable(self, force: Float[Array, " points"], near: Point) -> Optimised:
        """The optimum of forces near those of a fit, with its derivative in them.

        A Newton step on the optimality conditions from the fit, with parameters on a bound and active
        rows held. At the fit's own forces it has the derivative of the optimum.

        Args:
            force: of the readings [N].
            near: the optimum that was found, such as `result.end.point`.
        """
        at, q = np.asarray(self.free, int), len(self.free)
        width = (jnp.asarray(self.high) - self.low)[at]
        u, x = (near.parameters - self.low)[at] / width, jnp.asarray(near.x)
        moves = jnp.concatenate([(u > _HELD) & (u < 1 - _HELD), jnp.ones(x.shape, bool)])
        size = jnp.maximum(jnp.abs(x), jnp.max(jnp.abs(x)) * 1e-6 + 1e-300)
        active = np.zeros(near.h.size, bool)
        active[near.rows] = True
        multipliers = np.zeros(near.h.size)
        multipliers[near.rows] = near.multipliers

        def both(z: Float[Array, " z"], force: Array) -> tuple[Array, Array]:
            p, x = self.parameters(z[:q]), z[q:] * size
            residual, slack = self.exact(p, x, force, jnp.asarray(near.reached))
            return residual @ residual / 2, jnp.where(active, slack, 0.0)

        def lagrangian(z: Float[Array, " z"], force: Array) -> Float[Array, ""]:
            cost, slack = both(z, force)
            return cost - multipliers @ slack

        z, still = jnp.concatenate([u, x / size]), jax.lax.stop_gradient(force)
        curvature = jax.hessian(lagrangian)(z, still)
        rows = jax.jacfwd(lambda z: both(z, still)[1])(z)
        H = jnp.where(moves[:, None] & moves, curvature, jnp.eye(z.size))
        N = jnp.where(moves, rows, 0.0)
        off = jnp.diag(jnp.where(active, 0.0, 1.0))
        system = jax.lax.stop_gradient(jnp.block([[H, -N.T], [N, off]]))
        gradient = jnp.where(moves, jax.grad(lagrangian)(z, force), 0.0)
        conditions = jnp.concatenate([gradient, both(z, force)[1]])
        z = z + jnp.linalg.solve(system, -conditions)[: z.size]
        return Optimised(self.parameters(z[:q]), z[q:] * size)
