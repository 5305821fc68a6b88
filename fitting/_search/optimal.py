"""The optimum at the end of a descent, with the covariance of everything that was identified."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._convex.qp import Optimum
from .._model.problem import Problem
from .box import BoxOptimum
from .quick_jit import quick_jit
from .robust import Robust, pseudo_residual
from .search import Search, solve
from .uncertainty import Covariance, covariance


@dataclasses.dataclass(frozen=True)
class Optimal:
    """An optimum and all that is derived of it before it is told to a reader.

    Attributes:
        search: with its stations placed.
        parameters: nonlinear parameters [SI], shape (q,).
        optimum: of the convex fit.
        spread: covariance of the nonlinear parameters and then the coefficients.
        at_bound: nonlinear parameters on a bound.
    """

    search: Search
    parameters: Float[Array, " q"]
    optimum: Optimum
    spread: Covariance
    at_bound: Bool[np.ndarray, " q"]

    @property
    def problem(self) -> Problem:
        """The problem of the search."""
        return self.search.problem

    @property
    def coefficients(self) -> Float[np.ndarray, "nodes order"]:
        """Coefficients [Pa] of every node of every block."""
        return np.asarray(self.optimum.x).reshape(-1, self.problem.order)


@quick_jit
def joint_derivatives(
    problem: Problem, parameters: Float[Array, " q"], x: Float[Array, "blocks n"]
) -> tuple[Array, Array, Array]:
    """Weighted residual, its Jacobian and that of the constraint rows, in (parameters, x)."""
    reaches = problem.reaches(parameters)

    def both(parameters: Float[Array, " q"], flat: Float[Array, " n"]) -> tuple[Array, Array]:
        coefficients = flat.reshape(x.shape)
        _, _, G, h = problem.programmes(parameters, reaches)
        slack = (jnp.einsum("bmn,bn->bm", G, coefficients) - h).ravel()
        return problem.joint_residual(parameters, coefficients, reaches), slack

    residual, _ = both(parameters, x.ravel())
    (rp, rx), (cp, cx) = jax.jacfwd(both, argnums=(0, 1))(parameters, x.ravel())
    return residual, jnp.concatenate([rp, rx], axis=1), jnp.concatenate([cp, cx], axis=1)


def optimal(search: Search, best: BoxOptimum, robust: Robust | None = None) -> Optimal:
    """The optimum at the end of a descent, with its covariance; `robust` as the search is weighed."""
    parameters = search.parameters(best.u)
    optimum = solve(search.problem, parameters)
    moves, at_bound = np.zeros((2, len(search.names)), bool)
    u = np.asarray(best.u)
    moves[list(search.free)] = True
    at_bound[list(search.free)] = (u <= 1e-9) | (u >= 1 - 1e-9)
    held = np.concatenate([at_bound | ~moves, np.zeros(search.problem.n_coefficients, bool)])
    residual, jacobian, rows = map(
        np.asarray, joint_derivatives(search.problem, parameters, optimum.x)
    )
    active = np.asarray(optimum.active).ravel()
    n_priors = residual.size - sum(part.force.shape[0] for part in search.problem.parts)
    noise = float(search.problem.prior_weight)
    if robust is not None:
        # The readings in their own weights again, their residuals as Huber's theory counts them.
        own = np.concatenate([1 / robust.weight, np.ones(n_priors)])
        unknowns = int(np.sum(~held)) - len(set(map(tuple, rows[active])))
        jacobian = own[:, None] * jacobian
        residual = pseudo_residual(
            own * residual, robust.weight.size, robust.threshold, max(unknowns, 1)
        )
    spread = covariance(jacobian, residual, rows[active], held, n_priors=n_priors, noise=noise)
    return Optimal(search, parameters, optimum, spread, at_bound)
