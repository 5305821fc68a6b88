"""The same problems by others: SciPy's SLSQP and trust-constr, Clarabel, and a polished reference.

`slsqp` stands for what the reference work's fmincon does. Each solver is called as its users call
it, in a loop over the problems.
"""

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from identification_problem import Programme
from jaxtyping import Float
from scipy import optimize, sparse

clarabel: Any = importlib.import_module("clarabel")  # its compiled module names no types

Solver = Callable[[Any, str], Float[np.ndarray, " n"]]
"""The minimiser of a problem, or of what was prepared of it, under an objective."""


def value(one: Programme, x: Float[np.ndarray, " n"], objective: str) -> float:
    """The objective."""
    residual = one.A @ x - one.y
    if objective == "sum_of_squares":
        return float(np.sum(residual**2) / 2)
    return float(np.mean(np.sqrt(np.sum(residual**2, axis=1) / one.count)))


def gradient(one: Programme, x: Float[np.ndarray, " n"], objective: str) -> Float[np.ndarray, " n"]:
    """Its derivative."""
    residual = one.A @ x - one.y
    if objective == "sum_of_squares":
        return np.einsum("pkn,pk->n", one.A, residual)
    norm = np.sqrt(np.sum(residual**2, axis=1) * one.count)
    return np.einsum("pkn,pk,p->n", one.A, residual, 1 / norm) / len(norm)


def slsqp(
    one: Programme, objective: str, *, exact: bool = True, tolerance: float = 1e-12
) -> Float[np.ndarray, " n"]:
    """SciPy's SLSQP from small coefficients, with exact gradients or finite differences."""
    start = np.full(one.A.shape[-1], 1e-3 * np.abs(one.y).max())
    scale = 1 / max(value(one, start, objective), 1e-300)
    found = optimize.minimize(
        lambda x: scale * value(one, x, objective),
        start,
        jac=(lambda x: scale * gradient(one, x, objective)) if exact else None,
        constraints=_inequalities(one),
        method="SLSQP",
        options={"maxiter": 500, "ftol": tolerance},
    )
    return found.x


def slsqp_differences(one: Programme, objective: str) -> Float[np.ndarray, " n"]:
    """SciPy's SLSQP with finite differences, as fmincon by default."""
    return slsqp(one, objective, exact=False)


def slsqp_by_default(one: Programme, objective: str) -> Float[np.ndarray, " n"]:
    """SciPy's SLSQP with exact gradients and the tolerance that it has by default."""
    return slsqp(one, objective, tolerance=1e-6)


def trust_constr(one: Programme, objective: str) -> Float[np.ndarray, " n"]:
    """SciPy's trust-constr with exact first and second derivatives."""
    start = np.full(one.A.shape[-1], 1e-3 * np.abs(one.y).max())
    scale = 1 / max(value(one, start, objective), 1e-300)
    rows = [optimize.LinearConstraint(one.G, 0, np.inf)] if len(one.G) else []
    found = optimize.minimize(
        lambda x: scale * value(one, x, objective),
        start,
        jac=lambda x: scale * gradient(one, x, objective),
        hess=lambda x: scale * _hessian(one, x, objective),
        constraints=rows,
        method="trust-constr",
        options={"maxiter": 200},
    )
    return found.x


def _inequalities(one: Programme) -> list[dict]:
    if not len(one.G):
        return []
    return [{"type": "ineq", "fun": lambda x: one.G @ x, "jac": lambda _: one.G}]


Conic = tuple[Any, ...]
"""Matrices, cones and scale of a problem as Clarabel takes it."""


def conic(one: Programme, objective: str) -> Conic:
    """A problem under either objective; the mean RMSE has one second-order cone per block."""
    n, m, blocks = one.A.shape[-1], len(one.G), len(one.y)
    rows = [-one.G] if m else []
    cones: list = [clarabel.NonnegativeConeT(m)] if m else []
    right = [np.zeros(m)]
    if objective == "sum_of_squares":
        A = one.A.reshape(-1, n)
        P, q = A.T @ A, -A.T @ one.y.ravel()
        size = float(np.linalg.norm(q))
        q = q / size
    else:
        # The unknowns are x / size and the RMSE of each block / size.
        size = float(np.linalg.norm(one.y))
        P, q = np.zeros((n + blocks, n + blocks)), np.r_[np.zeros(n), np.full(blocks, 1 / blocks)]
        rows = [np.c_[row, np.zeros((m, blocks))] for row in rows]
        for p in range(blocks):
            top = np.r_[np.zeros(n), -np.sqrt(one.count[p]) * np.eye(blocks)[p]]
            rows += [top[None], np.c_[-one.A[p], np.zeros((one.A.shape[1], blocks))]]
            right += [np.zeros(1), -one.y[p] / size]
            cones.append(clarabel.SecondOrderConeT(one.A.shape[1] + 1))
    matrix = np.concatenate(rows) if rows else np.zeros((0, q.size))
    sparse_P, sparse_A = sparse.csc_matrix(np.triu(P)), sparse.csc_matrix(matrix)
    return sparse_P, q, sparse_A, np.concatenate(right), cones, size, n, m


def quadratic_conic(
    H: Float[np.ndarray, "n n"], g: Float[np.ndarray, " n"], G: sparse.csc_matrix
) -> Conic:
    """1/2 x H x - g x under G x >= 0, the rows given once for all."""
    size = float(np.linalg.norm(g))
    shape: Any = G.shape
    m = shape[0]
    cones = [clarabel.NonnegativeConeT(m)]
    return sparse.csc_matrix(np.triu(H)), -g / size, -G, np.zeros(m), cones, size, g.size, m


def clarabel_solver(given: Conic, objective: str = "") -> Float[np.ndarray, " n"]:
    """Clarabel called directly, without a modelling layer."""
    del objective
    return _clarabel(given)[0]


def _clarabel(given: Conic) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " m"]]:
    """Minimiser and multipliers of the rows."""
    P, q, A, b, cones, size, n, m = given
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    found = clarabel.DefaultSolver(P, q, A, b, cones, settings).solve()
    return np.array(found.x)[:n] * size, np.array(found.z)[:m]


def polished(one: Programme, objective: str) -> tuple[float, Float[np.ndarray, " n"]]:
    """Objective and minimiser: Clarabel's active rows, then Newton's method on their equations."""
    x, multipliers = _clarabel(conic(one, objective))
    active = multipliers > 1e-6 * max(multipliers.max(initial=0.0), 1e-300)
    active &= one.G @ x < 1e-5 * np.linalg.norm(x)
    # Rows that depend on others say nothing more.
    chosen: list[int] = []
    for row in np.flatnonzero(active)[np.argsort(-multipliers[active])]:
        if np.linalg.matrix_rank(one.G[[*chosen, row]], tol=1e-9) > len(chosen):
            chosen.append(int(row))
    N = one.G[chosen]
    basis = np.linalg.svd(N)[2][len(chosen) :].T if chosen else np.eye(x.size)
    x = basis @ (basis.T @ x)
    for _ in range(8):
        x = x - basis @ np.linalg.solve(
            basis.T @ _hessian(one, x, objective) @ basis, basis.T @ gradient(one, x, objective)
        )
    return value(one, x, objective), x


def _hessian(
    one: Programme, x: Float[np.ndarray, " n"], objective: str
) -> Float[np.ndarray, "n n"]:
    if objective == "sum_of_squares":
        return np.einsum("pkn,pkm->nm", one.A, one.A)
    residual = one.A @ x - one.y
    norm = np.linalg.norm(residual, axis=1)
    pull = np.einsum("pkn,pk->pn", one.A, residual) / norm[:, None]
    curvature = np.einsum("pkn,pkm->pnm", one.A, one.A) - pull[:, :, None] * pull[:, None, :]
    return np.einsum("pnm,p->nm", curvature, 1 / (norm * np.sqrt(one.count))) / len(norm)
