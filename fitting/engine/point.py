"""The fit at vectors of nonlinear parameters: the linear models and the convex optimum."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..convex.host_qp import Optima
from .response import Aside


@dataclasses.dataclass(frozen=True)
class Linear:
    """The linear model of a part at one point, in all of the problem's parameters, or at several.

    Attributes:
        force: [N] at no coefficients, shape (points,).
        columns: shape (points, n) of the part's coefficients.
        rows, values: of the constraint, g = rows x + values >= 0, (r, n) and (r,).
        d_force, d_columns, d_rows, d_values: derivatives in the part's parameters; those of the
            constraint are None on the way of a descent.
        derived, d_derived: what follows from the parameters; None on the way of a descent.
        aside: what has no derivative; on the way of a descent only what it needs.
        about: coefficients about which the model is linear, shape (n,).
        reached: force [N] at which a compliant rig was taken.
    """

    force: np.ndarray
    columns: np.ndarray
    rows: np.ndarray
    values: np.ndarray
    d_force: np.ndarray
    d_columns: np.ndarray
    d_rows: np.ndarray | None
    d_values: np.ndarray | None
    derived: np.ndarray | None
    d_derived: np.ndarray | None
    aside: Aside
    about: np.ndarray
    reached: np.ndarray


@dataclasses.dataclass(frozen=True)
class Point:
    """The fit at one vector of nonlinear parameters, or at several with a leading axis.

    Attributes:
        parameters: [SI], shape (*b, q).
        optimum: of the convex programme.
        residual: weighted, priors included, shape (*b, k).
        programme: (A, b, G, h) that was solved.
        linear: of each part.
    """

    parameters: Float[np.ndarray, "*b q"]
    optimum: Optima
    residual: Float[np.ndarray, "*b k"]
    programme: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    linear: tuple[Linear, ...]

    @property
    def x(self) -> Float[np.ndarray, "*b n"]:
        """Coefficients of all parts; nan without a certified optimum."""
        return self.optimum.x

    @property
    def cost(self) -> float:
        """Half the sum of the squared residuals of one fit."""
        return float(self.residual @ self.residual) / 2
