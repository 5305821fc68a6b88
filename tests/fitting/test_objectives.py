"""Objectives and exact constraints against conic programmes solved by somebody else."""

import clarabel
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import sparse

from fitting._convex.constraint import Constraint
from fitting._convex.convex_fit import ConvexFit, minimise
from fitting._convex.objectives import AbstractObjective, Huber, MeanRmse, SumOfSquares
from fitting._convex.path_functions import SlopeFunctions
from fitting._convex.path_table import PathTable, nodes_for
from fitting.engine.status import Status

ORDER, GROUPS, READINGS = 4, 3, 25
OBJECTIVE = 5e-7  # relative; Clarabel's accuracy, and 2000 points in place of the interval
CERTIFIED = 1e-10  # what the fit itself asks for
FEASIBLE = 1e-12  # per largest coefficient: rounding of the polynomial itself
DIFFERENCE = 2e-6  # central differences with step 1e-5
CURVED = 1e-4  # a dip's curvature is that of its cubic, of the second order in the width of a cell
FINE = 2000

POWERS = np.arange(1, ORDER + 1)
PHI = SlopeFunctions(jnp.array([1.0]), ORDER)


def readings(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Three groups, each of a law that dips by itself, of which one is much noisier."""
    rng = np.random.default_rng(seed)
    strain = rng.uniform(0, 1, (GROUPS, READINGS))
    noise = np.array([0.01, 0.02, 0.2])[:, None] * rng.standard_t(2, size=strain.shape)
    return strain[..., None] ** POWERS, strain - 3 * strain**2 + 2.4 * strain**3 + noise


@eqx.filter_jit
def fit(
    W: jax.Array, c: jax.Array, kind: str, threshold: jax.Array, exchange: bool = True
) -> tuple[ConvexFit, jax.Array]:
    """The fit in whitened unknowns, and its coefficients."""
    J = jnp.linalg.inv(jnp.linalg.qr(W.reshape(-1, ORDER))[1])
    constraint = Constraint(
        table=PathTable.at(PHI, jnp.linspace(0, 1, 33)[None]),
        exact=PHI,
        grid=jnp.arange(0, 33, 4),
        positive=jnp.array(False),
        on=jnp.array(True),
        basis=jnp.ones((1, 1)),
        to_x=J[:, None, :],
        used=jnp.ones(ORDER, bool),
    )
    weight = jnp.ones(GROUPS)
    objectives: dict[str, AbstractObjective] = {
        "sum_of_squares": SumOfSquares(W @ J, c, weight),
        "mean_rmse": MeanRmse(W @ J, c, weight, jnp.full(GROUPS, 1.0 * READINGS)),
        "huber": Huber(W @ J, c, jnp.ones_like(c), threshold),
    }
    found = minimise(objectives[kind], constraint, jnp.zeros(ORDER), exchange=exchange)
    return found, constraint.coefficients(found.y)[0]


def conic(A: np.ndarray, y: np.ndarray, kind: str, threshold: float) -> float:
    """The optimal objective with the slope asked for at 2000 points, by Clarabel."""
    A, y = A.reshape(-1, ORDER), y.ravel()
    slopes = POWERS * np.linspace(0, 1, FINE)[:, None] ** (POWERS - 1)
    n, k = ORDER, y.size
    if kind == "mean_rmse":  # unknowns E, t; (t_p, A_p E - y_p) in a second-order cone
        P, q = np.zeros((n + GROUPS,) * 2), np.r_[np.zeros(n), np.ones(GROUPS)]
        rows, right, cones = [np.c_[-slopes, np.zeros((FINE, GROUPS))]], [np.zeros(FINE)], []
        cones.append(clarabel.NonnegativeConeT(FINE))
        for p in range(GROUPS):
            own = slice(p * READINGS, (p + 1) * READINGS)
            top = np.r_[np.zeros(n), -np.eye(GROUPS)[p]]
            rows += [top[None], np.c_[-A[own], np.zeros((READINGS, GROUPS))]]
            right += [np.zeros(1), -y[own]]
            cones.append(clarabel.SecondOrderConeT(READINGS + 1))
        scale = 1 / (GROUPS * np.sqrt(READINGS))
    else:  # unknowns E, u, v: u^2 / 2 + threshold |A E - y - u|, the second part below v
        size = n + 2 * k
        P, q = np.zeros((size, size)), np.zeros(size)
        P[n : n + k, n : n + k] = np.eye(k)
        q[n + k :] = threshold
        eye, none = np.eye(k), np.zeros((k, k))
        if kind == "sum_of_squares":
            q[n + k :] = 1e3 * np.abs(y).max() * k
        rows = [np.c_[-slopes, np.zeros((FINE, 2 * k))], np.c_[A, -eye, -eye], np.c_[-A, eye, -eye]]
        right, cones = [np.zeros(FINE), y, -y], [clarabel.NonnegativeConeT(FINE + 2 * k)]
        scale = 1.0
        del none
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(P),
        q,
        sparse.csc_matrix(np.concatenate(rows)),
        np.concatenate(right),
        cones,
        settings,
    )
    solution = solver.solve()
    assert str(solution.status) in {"Solved", "AlmostSolved"}
    return scale * float(solution.obj_val)


def smallest_slope(E: np.ndarray) -> float:
    """Exact minimum over [0, 1] of the slope of a polynomial law."""
    slope = np.polynomial.Polynomial([0.0, *E]).deriv()
    roots = slope.deriv().roots()
    inside = roots[np.isreal(roots)].real
    at = np.r_[0.0, 1.0, inside[(inside > 0) & (inside < 1)]]
    return float(slope(at).min())


@pytest.mark.parametrize("kind", ["sum_of_squares", "mean_rmse", "huber"])
def test_optimum_is_certified_and_feasible_everywhere(kind: str) -> None:
    for seed in range(4):
        A, y = readings(seed)
        found, E = fit(jnp.asarray(A), jnp.asarray(y), kind, jnp.array(0.03))
        assert Status(int(found.status)) is Status.OPTIMAL
        assert float(found.kkt_residual) < CERTIFIED
        assert float(found.duality_gap) < 1e-8
        assert float(found.objective) == pytest.approx(conic(A, y, kind, 0.03), rel=OBJECTIVE)
        assert smallest_slope(np.asarray(E)) > -FEASIBLE * np.abs(E).max()
        assert int(found.active) > 0


@pytest.mark.parametrize("kind", ["sum_of_squares", "mean_rmse", "huber"])
def test_derivatives_in_the_data(kind: str) -> None:
    A, y = (jnp.asarray(part) for part in readings(1))
    rng = np.random.default_rng(0)
    dA, dy = (jnp.asarray(rng.normal(size=part.shape)) * jnp.abs(part) for part in (A, y))

    def along(step: jax.Array) -> jax.Array:
        return fit(A + step * dA, y + step * dy, kind, jnp.array(0.03))[1]

    forward = jax.jvp(along, (jnp.array(0.0),), (jnp.array(1.0),))[1]
    central = (along(jnp.array(1e-5)) - along(jnp.array(-1e-5))) / 2e-5
    size = float(jnp.max(jnp.abs(central)))
    np.testing.assert_allclose(forward, central, atol=DIFFERENCE * size, rtol=0)


QUARTIC = SlopeFunctions(jnp.array([1.0]), 5)
NODES = nodes_for(QUARTIC, 1)


@eqx.filter_jit
def quartic_fit(y: jax.Array) -> tuple[ConvexFit, jax.Array, jax.Array]:
    """A law of fifth order, whose slope no cubic is: fit, coefficients, and whether dips matter."""
    strain = jnp.linspace(0, 1, y.size)
    A = strain[:, None] ** jnp.arange(1, 6)
    J = jnp.linalg.inv(jnp.linalg.qr(A)[1])
    stations = np.linspace(0, NODES.shape[1] - 1, 9).round().astype(int)
    constraint = Constraint(
        table=PathTable.at(QUARTIC, NODES),
        exact=QUARTIC,
        grid=jnp.asarray(stations),
        positive=jnp.array(False),
        on=jnp.array(True),
        basis=jnp.ones((1, 1)),
        to_x=J[:, None, :],
        used=jnp.ones(5, bool),
    )
    aim = SumOfSquares((A @ J)[None], y[None], jnp.ones(1))
    found = minimise(aim, constraint, J.T @ A.T @ y)
    inside = ~constraint.table.at_node(found.dips.path, found.dips.s)
    return found, constraint.coefficients(found.y)[0], jnp.sum(inside & (found.dips.path >= 0))


def quartic_readings() -> np.ndarray:
    """A law that falls between 0.2 and 0.5."""
    strain = np.linspace(0, 1, 40)
    return strain * (strain - 0.2) * (strain - 0.5) + 0.02 * strain


def test_functions_themselves_hold_where_the_table_is_not_exact() -> None:
    found, E, dips = quartic_fit(jnp.asarray(quartic_readings()))
    E = np.asarray(E)
    assert int(dips) > 0  # or the test shows nothing
    assert int(found.active) > 0
    assert Status(int(found.status)) is Status.OPTIMAL
    assert smallest_slope(E) > -FEASIBLE * np.abs(E).max()


def test_derivatives_where_the_table_is_not_exact() -> None:
    y = jnp.asarray(quartic_readings())
    direction = jnp.asarray(np.random.default_rng(3).normal(size=y.shape)) * 0.01
    forward = jax.jvp(lambda y: quartic_fit(y)[1], (y,), (direction,))[1]
    step = 1e-5
    central = (quartic_fit(y + step * direction)[1] - quartic_fit(y - step * direction)[1]) / 2
    size = float(jnp.max(jnp.abs(central))) / step
    np.testing.assert_allclose(forward, central / step, atol=CURVED * size, rtol=0)
    backward = jax.grad(lambda y: jnp.sum(quartic_fit(y)[1]))(y)
    assert float(backward @ direction) == pytest.approx(float(jnp.sum(forward)), rel=1e-9)


def test_the_grid_alone_is_violated_between_its_points() -> None:
    """Without exchange the constraint must fail somewhere, or the exchange is not tested."""
    A, y = readings(0)
    given = (jnp.asarray(A), jnp.asarray(y), "sum_of_squares", jnp.array(0.03))
    coarse = fit(*given, exchange=False)[1]
    assert smallest_slope(np.asarray(coarse)) < -1e-5 * np.abs(coarse).max()


def test_a_perfect_group_is_a_corner_of_the_mean_rmse() -> None:
    """Two groups that contradict one another: the one with more weight is met exactly."""
    A, _ = readings(2)
    law = np.array([1.0, 0.5, 0.2, 0.1])
    y = A @ np.stack([law, law, 2 * law]).T
    y = np.stack([y[p, :, p] for p in range(GROUPS)])
    found, E = fit(jnp.asarray(A), jnp.asarray(y), "mean_rmse", jnp.array(0.03))
    expected = np.sqrt(np.mean((A[2] @ law) ** 2)) / GROUPS
    assert Status(int(found.status)) is Status.OPTIMAL
    np.testing.assert_allclose(E, law, atol=1e-6)  # the corner is rounded off over 1e-9 of the data
    assert float(found.objective) == pytest.approx(expected, rel=1e-8)
    assert float(found.duality_gap) < 1e-7


def test_cubics_follow_a_function_to_their_tolerance() -> None:
    table = PathTable.at(PHI, nodes_for(lambda path, s: jnp.exp(6 * s)[:, None], 1))
    assert table.nodes.shape[1] > 33

    def phi(path: jax.Array, s: jax.Array) -> jax.Array:
        return jnp.stack([jnp.exp(6 * s), jnp.abs(s - 0.3)], axis=-1)

    nodes = nodes_for(phi, 1)
    table = PathTable.at(phi, nodes)
    cells = jnp.arange(nodes.shape[1] - 1)
    for part in (0.21, 0.5, 0.79):
        s = nodes[0, :-1] + part * np.diff(nodes[0])
        rows = table.rows(jnp.zeros_like(cells), jnp.asarray(s))[0]
        np.testing.assert_allclose(rows[:, 0], np.exp(6 * s), atol=1e-8 * np.exp(6))
        np.testing.assert_allclose(rows[:, 1], np.abs(s - 0.3), atol=1e-5)  # narrowest cell


@pytest.mark.parametrize("seed", range(3))
def test_minima_of_cubics(seed: int) -> None:
    """Against a fine grid, for random combinations and for the degenerate ones."""
    rng = np.random.default_rng(seed)
    table = PathTable.at(PHI, np.array([[0.0, 0.3, 0.35, 1.0]]))
    minima = jax.jit(lambda E: table.minima(E))  # noqa: PLW0108 -- arrays have no hash
    for E in [*rng.normal(size=(20, 4)), *np.eye(4), *-np.eye(4), np.zeros(4)]:
        least, at = minima(jnp.asarray(E)[None])
        for cell, (low, high) in enumerate([(0, 0.3), (0.3, 0.35), (0.35, 1)]):
            s = np.linspace(low, high, 2001)
            slopes = POWERS * s[:, None] ** (POWERS - 1) @ E
            assert float(least[0, cell]) == pytest.approx(slopes.min(), abs=1e-6)
            assert float(least[0, cell]) <= slopes.min() + 1e-14 * max(1, np.abs(E).max())
            weakest = POWERS * float(at[0, cell]) ** (POWERS - 1) @ E
            assert low <= float(at[0, cell]) <= high
            assert weakest == pytest.approx(float(least[0, cell]), abs=1e-11)
