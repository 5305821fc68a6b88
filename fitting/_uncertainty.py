"""Standard errors of an optimum: Gauss-Newton covariance on the directions that stay free."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

CONDITION_LIMIT = 1e10
"""Beyond this condition number of the scaled Jacobian no standard error is given."""


@dataclasses.dataclass(frozen=True)
class Covariance:
    """Covariance of all parameters.

    Attributes:
        matrix: shape (p, p); rows of parameters that cannot move are nan.
        condition: condition number of the scaled Jacobian on the free directions.
        degrees_of_freedom: readings and priors minus free directions.
    """

    matrix: Float[np.ndarray, "p p"]
    condition: float
    degrees_of_freedom: int

    @property
    def stderr(self) -> Float[np.ndarray, " p"]:
        """Standard errors; nan for a parameter that is held, at a bound, or not identifiable."""
        return np.sqrt(np.diag(self.matrix))

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Correlation matrix, nan where there is no standard error."""
        return self.matrix / np.outer(self.stderr, self.stderr)


def covariance(
    jacobian: Float[np.ndarray, "k p"],
    residual: Float[np.ndarray, " k"],
    active: Float[np.ndarray, "a p"],
    held: Bool[np.ndarray, " p"],
) -> Covariance:
    """Gauss-Newton covariance s^2 Z (Z^T J^T J Z)^-1 Z^T of a constrained least-squares optimum.

    Z spans the directions in which the held parameters and the active constraints stay as they
    are, so these contribute no variance: their own entries are nan, never zero.

    Args:
        jacobian: of the weighted residual in all parameters.
        residual: weighted residual at the optimum.
        active: gradients of the active constraints.
        held: True for parameters at a bound or fixed.

    Returns:
        The covariance. Not valid where the model is wrong or a constraint is active only by
        chance; profile likelihood and bootstrap are the remedies.
    """
    p = jacobian.shape[1]
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    fixed_rows = np.concatenate([np.eye(p)[held], _unit(active / scale)])
    _, singular, directions = np.linalg.svd(fixed_rows, full_matrices=True)
    rank = int(np.sum(singular > 1e-10))
    Z = directions[rank:].T
    freedom = residual.size - Z.shape[1]
    nothing = np.full((p, p), np.nan)
    if Z.shape[1] == 0 or freedom <= 0:
        return Covariance(nothing, np.nan, freedom)
    _, s, Vt = np.linalg.svd(jacobian / scale @ Z, full_matrices=False)
    condition = float(s[0] / s[-1]) if s[-1] > 0 else np.inf
    if condition > CONDITION_LIMIT:
        return Covariance(nothing, condition, freedom)
    root = Z @ (Vt.T / s) / scale[:, None]
    matrix = root @ root.T * (residual @ residual / freedom)
    stuck = np.sqrt(np.diag(matrix)) * scale <= 1e-9 * np.sqrt(residual @ residual / freedom)
    matrix[stuck] = matrix[:, stuck] = np.nan
    return Covariance(matrix, condition, freedom)


def _unit(rows: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(size > 0, size, 1.0)
