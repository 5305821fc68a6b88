"""Standard errors at an optimum: Gauss-Newton covariance in the free directions."""

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float

CONDITION_LIMIT = 1e10
"""Standard errors are nan if the condition number of the scaled Jacobian exceeds this limit."""


@dataclasses.dataclass(frozen=True)
class Covariance:
    """Covariance of all parameters.

    Attributes:
        matrix: shape (p, p); rows and columns of parameters that cannot move are nan.
        sandwich: Huber-White estimate, valid for unequal noise; same shape.
        condition: condition number of the scaled Jacobian in the free directions.
        degrees_of_freedom: readings and priors minus free directions.
    """

    matrix: Float[np.ndarray, "p p"]
    sandwich: Float[np.ndarray, "p p"]
    condition: float
    degrees_of_freedom: int

    @property
    def stderr(self) -> Float[np.ndarray, " p"]:
        """Standard errors; nan for a parameter that is held fixed, at a bound, or not identifiable.

        Each is the larger of the plain and the sandwich estimate. The plain estimate is too small if
        the noise is unequal; the sandwich estimate is too small if there are few readings (Angrist &
        Pischke 2009, Mostly Harmless Econometrics, section 8.1).
        """
        return np.fmax(np.sqrt(np.diag(self.matrix)), self.sandwich_stderr)

    @property
    def sandwich_stderr(self) -> Float[np.ndarray, " p"]:
        """Standard errors from the sandwich estimate; nan where the plain errors are nan."""
        return np.sqrt(np.diag(self.sandwich))


def covariance(
    jacobian: Float[np.ndarray, "k p"],
    residual: Float[np.ndarray, " k"],
    active: Float[np.ndarray, "a p"],
    held: Bool[np.ndarray, " p"],
    *,
    bent: Float[np.ndarray, "c p"] | None = None,
    n_priors: int = 0,
    noise: float = 1.0,
) -> Covariance:
    """Return the Gauss-Newton covariance s^2 Z (Z^T J^T J Z)^-1 Z^T at a constrained optimum.

    Z spans the directions in which the held parameters and the active constraints do not change.
    Held parameters therefore contribute no variance; their own entries are nan, never zero.

    Args:
        jacobian: Jacobian of the weighted residual with respect to all parameters.
        residual: weighted residual at the optimum.
        active: gradients of the active constraints.
        held: True for parameters that are fixed or at a bound.
        bent: square-root factors of the curvature that active constraints add. They do not affect
            the noise estimate.
        n_priors: number of priors, which are the last rows of the residual.
        noise: standard deviation of a reading on which the weights of the priors are based. With
            priors, the estimated noise is at least this large; otherwise the priors would be given
            too much weight.

    Returns:
        The covariances. They are not valid if the model is wrong or a constraint is active only by
        chance; use profile likelihood or the bootstrap instead.
    """
    p = jacobian.shape[1]
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    curved = jacobian if bent is None else np.concatenate([jacobian, bent])
    root, condition = free_root(curved, active, held)
    freedom = residual.size - root.shape[1]
    nothing = np.full((p, p), np.nan)
    if not condition <= CONDITION_LIMIT or freedom <= 0:
        return Covariance(nothing, nothing, condition, freedom)
    variance = residual @ residual / freedom
    if n_priors:
        variance = max(variance, noise**2)
        # A prior that is met exactly is not thereby exact.
        residual = np.concatenate([residual[:-n_priors], np.full(n_priors, noise)])
    moves = root @ (root.T @ jacobian.T)
    matrix = (root @ root.T if bent is None or not len(bent) else moves @ moves.T) * variance
    # Use each reading's own residual, with the small-sample factor of MacKinnon & White.
    influence = moves * residual
    sandwich = influence @ influence.T * (residual.size / freedom)
    stuck = np.sqrt(np.diag(matrix)) * scale <= 1e-9 * np.sqrt(variance)
    for spread in (matrix, sandwich):
        spread[stuck] = spread[:, stuck] = np.nan
    return Covariance(matrix, sandwich, condition, freedom)


def free_root(
    jacobian: Float[np.ndarray, "k p"],
    active: Float[np.ndarray, "a p"],
    held: Bool[np.ndarray, " p"],
) -> tuple[Float[np.ndarray, "p directions"], float]:
    """Return a square-root factor of Z (Z^T J^T J Z)^-1 Z^T, and the condition number of the scaled J Z.

    Z spans the directions that held parameters and constraints leave free. If J Z is singular, the factor
    is zero and the condition number infinite. If no direction is free, the condition number is nan.

    Args:
        jacobian: Jacobian of the weighted residual with respect to all parameters.
        active: gradients of the active constraints.
        held: True for parameters that are fixed or at a bound.
    """
    p = jacobian.shape[1]
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    active = active / scale
    size = np.linalg.norm(active, axis=1, keepdims=True)
    fixed_rows = np.concatenate([np.eye(p)[held], active / np.where(size > 0, size, 1.0)])
    _, singular, directions = np.linalg.svd(fixed_rows, full_matrices=True)
    rank = int(np.sum(singular > 1e-10))
    Z = directions[rank:].T
    _, s, Vt = np.linalg.svd(jacobian / scale @ Z, full_matrices=False)
    if not s.size or not s[-1] > 0:
        return np.zeros((p, Z.shape[1])), math.inf if s.size else math.nan
    return Z @ (Vt.T / s) / scale[:, None], float(s[0] / s[-1])
