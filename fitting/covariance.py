"""Standard errors at an optimum: Gauss-Newton covariance in the free directions."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

CONDITION_LIMIT = 1e10
"""Beyond this condition number of the scaled Jacobian no standard error is given."""


@dataclasses.dataclass(frozen=True)
class Covariance:
    """Covariance of all parameters.

    Attributes:
        matrix: shape (p, p); rows of parameters that cannot move are nan.
        sandwich: the same without the belief that all readings are equally noisy (Huber-White).
        condition: condition number of the scaled Jacobian on the free directions.
        degrees_of_freedom: readings and priors minus free directions.
    """

    matrix: Float[np.ndarray, "p p"]
    sandwich: Float[np.ndarray, "p p"]
    condition: float
    degrees_of_freedom: int

    @property
    def stderr(self) -> Float[np.ndarray, " p"]:
        """Standard errors; nan for a parameter that is held, at a bound, or not identifiable.

        The larger of the two: one is too small where the noise is not equal, the other where the
        readings are few (Angrist & Pischke 2009, Mostly Harmless Econometrics, section 8.1).
        """
        return np.fmax(self.plain_stderr, self.sandwich_stderr)

    @property
    def plain_stderr(self) -> Float[np.ndarray, " p"]:
        """Standard errors if all readings are equally noisy."""
        return np.sqrt(np.diag(self.matrix))

    @property
    def sandwich_stderr(self) -> Float[np.ndarray, " p"]:
        """Standard errors of the sandwich; nan where the others are."""
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
    """Gauss-Newton covariance s^2 Z (Z^T J^T J Z)^-1 Z^T of a constrained least-squares optimum.

    Z spans the directions in which the held parameters and the active constraints stay as they
    are, so these contribute no variance: their own entries are nan, never zero.

    Args:
        jacobian: of the weighted residual in all parameters.
        residual: weighted residual at the optimum.
        active: gradients of the active constraints.
        held: True for parameters at a bound or fixed.
        bent: roots of what active constraints add to the curvature; they tell nothing of the noise.
        n_priors: rows at the end of the residual that are priors.
        noise: standard deviation of a reading against which these were weighed. With priors the
            noise is at least this, or they would count for more than was said of them.

    Returns:
        The covariances. Not valid where the model is wrong or a constraint is active only by
        chance; profile likelihood and bootstrap are the remedies.
    """
    p = jacobian.shape[1]
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    curved = jacobian if bent is None else np.concatenate([jacobian, bent])
    root, directions, condition = free_root(curved, active, held)
    freedom = residual.size - directions
    nothing = np.full((p, p), np.nan)
    if directions == 0 or freedom <= 0 or condition > CONDITION_LIMIT:
        return Covariance(nothing, nothing, condition, freedom)
    variance = residual @ residual / freedom
    if n_priors:
        variance = max(variance, noise**2)
        # A prior that is met exactly is no proof that it is exact.
        residual = np.concatenate([residual[:-n_priors], np.full(n_priors, noise)])
    moves = root @ (root.T @ jacobian.T)
    matrix = (root @ root.T if bent is None or not len(bent) else moves @ moves.T) * variance
    # Each reading's own residual in place of one noise, with MacKinnon & White's small-sample factor.
    influence = moves * residual
    sandwich = influence @ influence.T * (residual.size / freedom)
    stuck = np.sqrt(np.diag(matrix)) * scale <= 1e-9 * np.sqrt(variance)
    for spread in (matrix, sandwich):
        spread[stuck] = spread[:, stuck] = np.nan
    return Covariance(matrix, sandwich, condition, freedom)


class FreeRoot(NamedTuple):
    """A root of (Z^T J^T J Z)^-1 in all parameters.

    Attributes:
        root: R with R R^T = Z (Z^T J^T J Z)^-1 Z^T, shape (p, directions).
        directions: number of directions that stay free.
        condition: condition number of the scaled Jacobian on them; nan where there is none.
    """

    root: Float[np.ndarray, "p directions"]
    directions: int
    condition: float


def free_root(
    jacobian: Float[np.ndarray, "k p"],
    active: Float[np.ndarray, "a p"],
    held: Bool[np.ndarray, " p"],
) -> FreeRoot:
    """The root on the directions Z in which held parameters and active constraints stay.

    Args:
        jacobian: of the weighted residual in all parameters.
        active: gradients of the active constraints.
        held: True for parameters at a bound or fixed.
    """
    p = jacobian.shape[1]
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    fixed_rows = np.concatenate([np.eye(p)[held], _unit(active / scale)])
    _, singular, directions = np.linalg.svd(fixed_rows, full_matrices=True)
    rank = int(np.sum(singular > 1e-10))
    Z = directions[rank:].T
    if Z.shape[1] == 0:
        return FreeRoot(np.zeros((p, 0)), 0, math.nan)
    _, s, Vt = np.linalg.svd(jacobian / scale @ Z, full_matrices=False)
    if not s[-1] > 0:
        return FreeRoot(np.zeros((p, 0)), Z.shape[1], math.inf)
    return FreeRoot(Z @ (Vt.T / s) / scale[:, None], Z.shape[1], float(s[0] / s[-1]))


def _unit(rows: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(size > 0, size, 1.0)
