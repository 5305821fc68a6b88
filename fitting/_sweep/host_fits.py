"""The fits of a sweep on the host: each a small convex programme of one linear model.

`fits.solve_all` is the driver for batches of sweeps and for derivatives.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from .._convex.host_fit import HostConstraint, HostFit, minimise_on_host
from .._convex.objectives import AbstractObjective, Huber, MeanRmse, SumOfSquares
from ..engine.status import Status
from .forms import Forms
from .host_design import HostDesign

_EPS = float(np.finfo(float).eps)


@dataclasses.dataclass(frozen=True)
class HostFits:
    """The fits of a sweep, with leading axes (dependences, orders, constraints) of its forms.

    Attributes:
        coefficients: E_n [Pa] at each pressure, shape (..., pressures, order); nan unless OPTIMAL.
        objective: minimum of the objective; of a free law, summed or averaged over pressures.
        kkt_residual, duality_gap: worst of a fit's problems.
        condition: largest of a fit's problems.
        steps: Newton steps, most of a fit's problems.
        active: rows with a multiplier, in all.
        status: the worst `Status` of a fit's problems.
    """

    coefficients: Float[np.ndarray, "*fits pressures order"]
    objective: Float[np.ndarray, "*fits"]
    kkt_residual: Float[np.ndarray, "*fits"]
    duality_gap: Float[np.ndarray, "*fits"]
    condition: Float[np.ndarray, "*fits"]
    steps: Int[np.ndarray, "*fits"]
    active: Int[np.ndarray, "*fits"]
    status: Int[np.ndarray, "*fits"]

    @classmethod
    def empty(cls, forms: Forms, pressures: int) -> "HostFits":
        """Room for the fits of some forms."""
        numbers = (np.full(forms.shape, np.nan) for _ in range(4))
        counts = (np.zeros(forms.shape, int) for _ in range(3))
        return cls(np.zeros((*forms.shape, pressures, forms.orders[-1])), *numbers, *counts)


@dataclasses.dataclass(frozen=True)
class _Unknowns:
    """What a law's fit solves for, whitened: with y the residuals have a curvature of one.

    Attributes:
        paths: indices of its pressures.
        on_y: scaled coefficients at these per unknown, shape (paths, order, n).
        start: the unconstrained optimum of the sum of squares, shape (n,).
        condition: of the columns.
        deficient: whether the data cannot tell the coefficients apart.
    """

    paths: Int[np.ndarray, " paths"]
    on_y: Float[np.ndarray, "paths order n"]
    start: Float[np.ndarray, " n"]
    condition: float
    deficient: bool

    @property
    def order(self) -> int:
        """Of the law."""
        return self.on_y.shape[1]

    @classmethod
    def of(
        cls,
        design: HostDesign,
        paths: Int[np.ndarray, " paths"],
        basis: Float[np.ndarray, "paths basis"],
        order: int,
    ) -> "_Unknowns":
        """Those of a law whose coefficients at the paths are shares of a few."""
        columns = design.factor[paths, :, :order]
        A = (columns[..., None] * basis[:, None, None, :]).reshape(-1, order * basis.shape[1])
        Q, R = np.linalg.qr(A)
        n = R.shape[1]
        scale = np.linalg.norm(R, axis=0)
        scale[~(scale > 0)] = 1.0
        R = R / scale
        inverse, condition = np.eye(n), np.inf
        if np.abs(np.diagonal(R)).min() > _EPS * np.linalg.norm(R):
            inverse = np.linalg.inv(R)
            condition = float(np.sqrt(n) * np.linalg.norm(inverse))
        to_x = (inverse / scale[:, None]).reshape(order, basis.shape[1], n)
        return cls(
            paths=paths,
            on_y=np.einsum("pb,ebn->pen", basis, to_x),
            start=Q.T @ design.factor[paths, :, -1].ravel(),
            condition=condition,
            deficient=not condition * 10 * design.target.size * _EPS < 1,
        )


class HostSolver:
    """Fits of one linear problem by one objective.

    Args:
        design: the problem.
        objective: one of `OBJECTIVES`.
    """

    def __init__(self, design: HostDesign, objective: str) -> None:
        self.design, self.objective = design, objective
        self._threshold = design.huber_threshold() if objective == "huber" else np.nan

    def solve(
        self, forms: Forms, *, leave_out: bool = False
    ) -> tuple[HostFits, Float[np.ndarray, "*fits pressures"]]:
        """The fits of some forms.

        Args:
            forms: of the law.
            leave_out: also fit without each pressure in turn.

        Returns:
            The fits. And of those without a pressure, the sum of squares [N^2] there, nan where
            the form says nothing about another pressure: a free law, and a linear one of two.
        """
        n_pressures = len(self.design.target)
        fits = HostFits.empty(forms, n_pressures)
        left_out = np.full((*forms.shape, n_pressures), np.nan)
        for d, dependence in enumerate(forms.dependences):
            for o, order in enumerate(forms.orders):
                unknowns = self._unknowns(dependence, order)
                for c, kind in enumerate(forms.constraints):
                    constraints = [self._constraint(some, kind) for some in unknowns]
                    found = self._one(fits, (d, o, c), unknowns, constraints)
                    known = n_pressures > 1 + (dependence == "linear")
                    if leave_out and dependence != "free" and known:
                        left_out[d, o, c] = self._beyond(unknowns[0], constraints[0], found[0])
        return fits, left_out

    def _unknowns(self, dependence: str, order: int) -> list[_Unknowns]:
        """Those of the problems into which a form falls."""
        every = np.arange(len(self.design.target))
        if dependence == "free":
            one = np.ones((1, 1))
            return [_Unknowns.of(self.design, every[p : p + 1], one, order) for p in every]
        basis = self.design.basis if dependence == "linear" else np.ones((every.size, 1))
        return [_Unknowns.of(self.design, every, basis, order)]

    def _one(
        self,
        fits: HostFits,
        at: tuple[int, int, int],
        unknowns: list[_Unknowns],
        constraints: list[HostConstraint],
    ) -> list[HostFit]:
        """One fit, which has a problem for each pressure if it is free there."""
        found = []
        for some, constraint in zip(unknowns, constraints, strict=True):
            fit, order = HostFit.without(some.start.size, Status.RANK_DEFICIENT), some.order
            if not some.deficient:
                aim = self._aim(some, np.ones(some.paths.size))
                fit = minimise_on_host(aim, constraint, some.start)
            found.append(fit)
            E = constraint.coefficients(fit.y) * self.design.unit[:order]
            fits.coefficients[at][some.paths, :order] = E if fit.optimal else np.nan
            fits.coefficients[at][some.paths, order:] = 0.0 if fit.optimal else np.nan
        total: Callable = np.mean if self.objective == "mean_rmse" else np.sum
        fits.objective[at] = total([fit.objective for fit in found])
        fits.kkt_residual[at] = np.max([fit.kkt_residual for fit in found])
        fits.duality_gap[at] = np.max([fit.duality_gap for fit in found])
        fits.condition[at] = max(some.condition for some in unknowns)
        fits.steps[at] = max(fit.steps for fit in found)
        fits.active[at] = sum(fit.active for fit in found)
        fits.status[at] = max(fit.status for fit in found)
        return found

    def _constraint(self, some: _Unknowns, kind: str) -> HostConstraint:
        if kind == "none":
            return HostConstraint.none(some.on_y)
        if kind == "positive":
            return HostConstraint.positive(some.on_y)
        along = self.design.slope if kind == "slope" else self.design.drucker
        return along.on(some.paths, some.on_y)

    def _aim(self, some: _Unknowns, keep: Float[np.ndarray, " paths"]) -> AbstractObjective:
        """The objective; a pressure that is not kept counts for nothing."""
        of, paths, order = self.design, some.paths, some.order
        weight, there = of.weight[paths], of.there[paths]
        if self.objective == "huber":
            W = of.A[paths, :, :order] * weight[..., None] @ some.on_y
            return Huber(W, of.target[paths] * weight, there * keep[:, None], self._threshold)
        W, c = of.factor[paths, :, :order] @ some.on_y, of.factor[paths, :, -1]
        if self.objective == "mean_rmse":
            return MeanRmse(W, c, keep, there.sum(axis=1) * 1.0)
        return SumOfSquares(W, c, keep)

    def _beyond(
        self, some: _Unknowns, constraint: HostConstraint, whole: HostFit
    ) -> Float[np.ndarray, " pressures"]:
        """Sum of squares [N^2] at each pressure of the fit without it."""
        square = np.full(some.paths.size, np.nan)
        for left in range(square.size if whole.optimal else 0):
            keep = np.ones(square.size)
            keep[left] = 0.0
            fit = minimise_on_host(self._aim(some, keep), constraint, some.start, whole.rows)
            if fit.optimal:
                E = constraint.coefficients(fit.y)[left]
                residual = self.design.A[left, :, : E.size] @ E - self.design.target[left]
                square[left] = np.sum(residual[self.design.there[left]] ** 2)
        return square
