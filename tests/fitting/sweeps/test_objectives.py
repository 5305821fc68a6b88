"""Objectives and exact constraints against conic programmes solved by somebody else."""

from collections.abc import Callable

import clarabel
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import sparse

from fitting.convex import Status
from fitting.sweeps.constraint import Constraint
from fitting.sweeps.minimise import ConvexFits, minimise
from fitting.sweeps.objectives import AbstractObjective, Huber, MeanRmse, SumOfSquares
from fitting.sweeps.paths import PathFunctions, PathTable

ORDER, GROUPS, READINGS = 4, 3, 25
THRESHOLD = 0.03  # of Huber's objective
OBJECTIVE = 5e-7  # relative; Clarabel's accuracy, and 2000 points in place of the interval
CERTIFIED = 1e-10  # what the fit itself asks for
FEASIBLE = 1e-12  # per largest coefficient: rounding of the polynomial itself
DIFFERENCE = 2e-6  # central differences with step 1e-5
FINE = 2000

POWERS = np.arange(1, ORDER + 1)
NUMPY, JAX = np.asarray, jnp.asarray
NONE = np.zeros(0)  # corners that are known
KINDS = ("sum_of_squares", "mean_rmse", "huber")


def slopes(order: int) -> PathFunctions:
    """The slope of a polynomial law over strains from 0 to 1."""
    powers = np.arange(1, order + 1)
    return PathFunctions.of(lambda s: powers * s[..., None] ** (powers - 1), [NONE])


def readings(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Three groups, each of a law that dips by itself, of which one is much noisier."""
    rng = np.random.default_rng(seed)
    strain = rng.uniform(0, 1, (GROUPS, READINGS))
    noise = np.array([0.01, 0.02, 0.2])[:, None] * rng.standard_t(2, size=strain.shape)
    return strain[..., None] ** POWERS, strain - 3 * strain**2 + 2.4 * strain**3 + noise


def fit(
    A: jax.Array | np.ndarray,
    c: jax.Array | np.ndarray,
    kind: str,
    *,
    stations: int = 4,
    exchange: bool = True,
) -> tuple[ConvexFits, jax.Array | np.ndarray]:
    """The fit in whitened unknowns by the driver whose arrays are given, and its coefficients."""
    xp, order, every = A.__array_namespace__(), A.shape[-1], slopes(A.shape[-1])
    J = xp.linalg.inv(xp.linalg.qr(A.reshape(-1, order))[1])
    functions, table = (jax.tree.map(xp.asarray, tree) for tree in (every, every.table()))
    posed = np.arange(0, every.table().nodes.shape[1], stations)
    constraint = Constraint.along(J[None, None], np.zeros((1, 1), int), functions, table, posed)
    W, c, weight = (A @ J)[None], c[None], xp.ones((1, len(A)))
    objectives: dict[str, AbstractObjective] = {
        "sum_of_squares": SumOfSquares(W, c, weight),
        "mean_rmse": MeanRmse(W, c, weight, xp.full(weight.shape, 1.0 * A.shape[1])),
        "huber": Huber(W, c, weight, xp.ones_like(c), xp.full((1, 1, 1), THRESHOLD)),
    }
    start = (A.reshape(-1, order) @ J).T @ c.ravel()
    found = minimise(objectives[kind], constraint, start[None], exchange=exchange)
    return found, constraint.coefficients(found.y)[0, 0]


compiled = jax.jit(fit, static_argnames=("kind", "stations", "exchange"))
DRIVERS: dict[str, tuple[Callable, Callable]] = {"host": (NUMPY, fit), "batch": (JAX, compiled)}


def conic(A: np.ndarray, y: np.ndarray, kind: str) -> float:
    """The optimal objective with the slope asked for at 2000 points, by Clarabel."""
    A, y = A.reshape(-1, ORDER), y.ravel()
    G = POWERS * np.linspace(0, 1, FINE)[:, None] ** (POWERS - 1)
    n, k = ORDER, y.size
    if kind == "mean_rmse":  # unknowns E, t; (t_p, A_p E - y_p) in a second-order cone
        P, q = np.zeros((n + GROUPS,) * 2), np.r_[np.zeros(n), np.ones(GROUPS)]
        rows, right, cones = [np.c_[-G, np.zeros((FINE, GROUPS))]], [np.zeros(FINE)], []
        cones.append(clarabel.NonnegativeConeT(FINE))
        for p in range(GROUPS):
            own = slice(p * READINGS, (p + 1) * READINGS)
            top = np.r_[np.zeros(n), -np.eye(GROUPS)[p]]
            rows += [top[None], np.c_[-A[own], np.zeros((READINGS, GROUPS))]]
            right += [np.zeros(1), -y[own]]
            cones.append(clarabel.SecondOrderConeT(READINGS + 1))
        scale = 1 / (GROUPS * np.sqrt(READINGS))
    else:  # unknowns E, u, v: u^2 / 2 + d |A E - y - u|, the second part below v
        size = n + 2 * k
        P, q = np.zeros((size, size)), np.zeros(size)
        P[n : n + k, n : n + k] = np.eye(k)
        q[n + k :] = THRESHOLD
        eye, none = np.eye(k), np.zeros((k, k))
        if kind == "sum_of_squares":
            q[n + k :] = 1e3 * np.abs(y).max() * k
        rows = [np.c_[-G, np.zeros((FINE, 2 * k))], np.c_[A, -eye, -eye], np.c_[-A, eye, -eye]]
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


@pytest.mark.slow
@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("kind", KINDS)
def test_optimum_is_certified_and_feasible_everywhere(kind: str, driver: str) -> None:
    array, solve = DRIVERS[driver]
    for seed in range(4):
        A, y = readings(seed)
        found, E = solve(array(A), array(y), kind)
        assert Status(int(found.status[0])) is Status.OPTIMAL
        assert float(found.kkt_residual[0]) < CERTIFIED
        assert float(found.duality_gap[0]) < 1e-8
        assert float(found.objective[0]) == pytest.approx(conic(A, y, kind), rel=OBJECTIVE)
        assert smallest_slope(np.asarray(E)) > -FEASIBLE * np.abs(E).max()
        assert int(found.active[0]) > 0


def test_members_of_a_batch_are_what_they_are_alone() -> None:
    """On the host those that have arrived are put aside while the others go on."""
    given = [readings(seed) for seed in range(6)]
    alone = [fit(A, y, "mean_rmse") for A, y in given]
    J = [np.linalg.inv(np.linalg.qr(A.reshape(-1, ORDER))[1]) for A, _ in given]
    functions = slopes(ORDER)
    stations = np.arange(0, 33, 4)
    constraint = Constraint.along(
        np.stack(J)[:, None], np.zeros((6, 1), int), functions, functions.table(), stations
    )
    W, c = (
        np.stack(leaves)
        for leaves in zip(
            *((A @ one, y) for one, (A, y) in zip(J, given, strict=True)), strict=True
        )
    )
    start = np.einsum("bpkn,bpk->bn", W, c)
    weight = np.ones((6, GROUPS))
    found = minimise(MeanRmse(W, c, weight, READINGS * weight), constraint, start)
    assert len(set(found.steps.tolist())) > 1
    np.testing.assert_array_equal(found.steps, [one.steps[0] for one, _ in alone])
    np.testing.assert_allclose(
        constraint.coefficients(found.y)[:, 0], [E for _, E in alone], rtol=0, atol=1e-11
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_in_the_data(kind: str) -> None:
    A, y = (jnp.asarray(part) for part in readings(1))
    rng = np.random.default_rng(0)
    dA, dy = (jnp.asarray(rng.normal(size=part.shape)) * jnp.abs(part) for part in (A, y))

    def along(step: jax.Array) -> jax.Array:
        return compiled(A + step * dA, y + step * dy, kind)[1]

    forward = jax.jvp(along, (jnp.array(0.0),), (jnp.array(1.0),))[1]
    central = (along(jnp.array(1e-5)) - along(jnp.array(-1e-5))) / 2e-5
    size = float(jnp.max(jnp.abs(central)))
    np.testing.assert_allclose(forward, central, atol=DIFFERENCE * size, rtol=0)


def quintic() -> tuple[np.ndarray, np.ndarray]:
    """A law of fifth order, whose slope no cubic is, and readings that fall between 0.2 and 0.5."""
    strain = np.linspace(0, 1, 40)
    y = strain * (strain - 0.2) * (strain - 0.5) + 0.02 * strain
    return (strain[:, None] ** np.arange(1, 6))[None], y[None]


@pytest.mark.slow
@pytest.mark.parametrize("driver", DRIVERS)
def test_functions_themselves_hold_where_no_cubic_does(driver: str) -> None:
    array, solve = DRIVERS[driver]
    found, E = solve(*(array(part) for part in quintic()), "sum_of_squares")
    E = np.asarray(E)
    rows = np.asarray(found.rows[0][0])[np.asarray(found.rows[1][0])]
    assert (rows >= 9).any()  # between the stations, or the test shows nothing
    assert Status(int(found.status[0])) is Status.OPTIMAL
    assert smallest_slope(E) > -FEASIBLE * np.abs(E).max()


@pytest.mark.slow
def test_derivatives_where_no_cubic_holds() -> None:
    A, y = (jnp.asarray(part) for part in quintic())
    direction = jnp.asarray(np.random.default_rng(3).normal(size=y.shape)) * 0.01

    def along(y: jax.Array) -> jax.Array:
        return compiled(A, y, "sum_of_squares")[1]

    forward = jax.jvp(along, (y,), (direction,))[1]
    step = 1e-5
    central = (along(y + step * direction) - along(y - step * direction)) / 2
    size = float(jnp.max(jnp.abs(central))) / step
    np.testing.assert_allclose(forward, central / step, atol=DIFFERENCE * size, rtol=0)
    backward = jax.grad(lambda y: jnp.sum(along(y)))(y)
    assert float(jnp.vdot(backward, direction)) == pytest.approx(float(jnp.sum(forward)), rel=1e-9)


def test_the_stations_alone_are_violated_between_them() -> None:
    """Without exchange the constraint must fail somewhere, or the exchange is not tested."""
    _, E = fit(*readings(0), "sum_of_squares", exchange=False)
    assert smallest_slope(E) < -1e-5 * np.abs(E).max()


def test_a_perfect_group_is_a_corner_of_the_mean_rmse() -> None:
    """Two groups that contradict one another: the one with more weight is met exactly."""
    A, _ = readings(2)
    law = np.array([1.0, 0.5, 0.2, 0.1])
    y = A @ np.stack([law, law, 2 * law]).T
    y = np.stack([y[p, :, p] for p in range(GROUPS)])
    found, E = fit(A, y, "mean_rmse")
    expected = np.sqrt(np.mean((A[2] @ law) ** 2)) / GROUPS
    assert Status(int(found.status[0])) is Status.OPTIMAL
    np.testing.assert_allclose(E, law, atol=1e-6)  # the corner is rounded off over 1e-9 of the data
    assert float(found.objective[0]) == pytest.approx(expected, rel=1e-8)
    assert float(found.duality_gap[0]) < 1e-7


def test_functions_are_those_that_were_sampled() -> None:
    """A smooth one with its derivatives, and one with a corner."""
    s = np.linspace(0, 1, 1001)
    path = np.zeros(s.size, int)
    smooth = PathFunctions.of(lambda s: np.exp(6 * s)[..., None], [NONE])
    for k, row in enumerate(smooth.rows(path, s, 2)):
        exact = 6**k * np.exp(6 * s)
        np.testing.assert_allclose(row[:, 0], exact, atol=1e-10 * exact.max(), rtol=0)
    corner = PathFunctions.of(lambda s: np.abs(s - 0.3)[..., None], [NONE])
    np.testing.assert_allclose(corner.rows(path, s)[0][:, 0], np.abs(s - 0.3), atol=1e-9)
    least, at, _ = corner.table().minima(np.ones((1, 1)))
    assert at[0, least[0].argmin()] == pytest.approx(0.3, abs=1e-9)  # narrowest piece
    known = PathFunctions.of(lambda s: np.abs(s - 0.3)[..., None], [np.array([0.3, 0.3, 1.0])])
    np.testing.assert_allclose(known.rows(path, s)[0][:, 0], np.abs(s - 0.3), atol=1e-15)
    assert known.start.size == 4 < corner.start.size


@pytest.mark.parametrize("seed", range(3))
def test_minima_of_cubics(seed: int) -> None:
    """Against a fine grid, for random combinations and for the degenerate ones."""
    rng = np.random.default_rng(seed)
    nodes = np.array([[0.0, 0.3, 0.35, 1.0]])
    table = PathTable(nodes, *slopes(ORDER).rows(np.zeros((1, 1), int), nodes, 1))
    for E in [*rng.normal(size=(20, 4)), *np.eye(4), *-np.eye(4), np.zeros(4)]:
        least, at, _ = table.minima(E[None])
        for cell, (low, high) in enumerate([(0, 0.3), (0.3, 0.35), (0.35, 1)]):
            s = np.linspace(low, high, 2001)
            of_law = POWERS * s[:, None] ** (POWERS - 1) @ E
            assert float(least[0, cell]) == pytest.approx(of_law.min(), abs=1e-6)
            assert float(least[0, cell]) <= of_law.min() + 1e-14 * max(1, np.abs(E).max())
            weakest = POWERS * float(at[0, cell]) ** (POWERS - 1) @ E
            assert low <= float(at[0, cell]) <= high
            assert weakest == pytest.approx(float(least[0, cell]), abs=1e-11)
