"""The sweep against Clarabel on a fine grid, its scores and its pictures."""

import dataclasses
from collections.abc import Callable

import clarabel
import numpy as np
import pytest
from maps import clarabel_objective, solved

import famjax
from fitting import ForceData, InputError, Specimen, sweep
from fitting.convex import Status
from fitting.sweeps import FEASIBLE, Sweep, SweepRow

OBJECTIVE = 1e-6  # relative; Clarabel's accuracy, and 4000 stations in place of the path
REST, PRESSURES, STATIONS = 0.2, np.array([1e5, 2e5, 3e5]), 4000
SOFTENING = np.array([2.5e6, -4.5e6, 2.4e6])  # its tangent falls below zero and rises again


def geometry(diameter: float = 0.022) -> famjax.EstimatedGeometry:
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=1.2, length=REST, thickness=2e-4)
    return famjax.EstimatedGeometry(braid, famjax.Bladder(REST, 0.02, 1.5e-3))


def measured(noise: float, seed: int = 0) -> ForceData:
    length, pressure = (g.ravel() for g in np.meshgrid(REST * np.linspace(1, 0.8, 21), PRESSURES))
    muscle = famjax.Muscle(geometry(), famjax.PolynomialMaterial(SOFTENING), 1e4)
    force = np.asarray(muscle.force(length, pressure))
    force = force + noise * np.random.default_rng(seed).normal(size=force.size)
    return ForceData(force, pressure, length, Specimen("softening", REST, 1.5e-3))


DATA = measured(noise=2.0)


@pytest.fixture(scope="module")
def swept() -> Sweep:
    return sweep(DATA, geometry(), deadband=1e4, orders=(2, 3))


def row(of: Sweep, dependence: str, order: int, constraint: str) -> SweepRow:
    key = (dependence, order, constraint)
    (found,) = (r for r in of.rows if (r.dependence, r.order, r.constraint) == key)
    return found


def of_units(order: int, function: Callable[[famjax.PolynomialMaterial], object]) -> np.ndarray:
    """What a function says of laws with one coefficient of 1 Pa, one column each."""
    columns = [function(famjax.PolynomialMaterial(E)) for E in np.eye(order)]
    return np.stack([np.asarray(column) for column in columns], axis=-1)


def constraint_rows(constraint: str, order: int, pressure: float, end: float) -> np.ndarray:
    """Rows on E_n at one pressure, on a grid that has nothing to do with the sweep's."""
    s = np.linspace(0, 1, STATIONS)
    length = REST + s * (end - REST)
    if constraint == "none":
        return np.zeros((1, order))
    if constraint == "positive":
        return np.eye(order)
    if constraint == "slope":
        at = geometry().dimensions(np.array([REST, end]), pressure)
        largest = max(np.abs(at.hoop_strain).max(), np.abs(at.axial_strain).max())
        return np.arange(1, order + 1) * (s * largest)[:, None] ** np.arange(order)
    return of_units(order, lambda law: famjax.path_modulus(law, geometry(), length, pressure))


def path_end(pressure: float) -> float:
    at = DATA.pressure == pressure
    shortest = DATA.length[at & DATA.loaded].min()
    slack = DATA.length[at & ~DATA.loaded & (DATA.length < shortest)]
    return float(slack.max(initial=-np.inf)) if slack.size else float(shortest)


def programme(dependence: str, constraint: str, order: int) -> tuple[np.ndarray, ...]:
    """A, b and G of a fit, and the place of each reading's pressure."""
    loaded = DATA.loaded
    at = DATA.length[loaded], DATA.pressure[loaded]
    braid = famjax.Muscle(geometry(), famjax.PolynomialMaterial([0.0]), 1e4)
    target = DATA.force[loaded] - np.asarray(braid.braid_force(*at))
    share = (PRESSURES - PRESSURES[0]) / (PRESSURES[-1] - PRESSURES[0])
    linear = np.stack([1 - share, share], axis=1)
    bases = {"fixed": np.ones((3, 1)), "linear": linear, "free": np.eye(3)}
    basis, of = bases[dependence], np.searchsorted(PRESSURES, at[1])
    columns = of_units(order, lambda law: famjax.Muscle(geometry(), law).bladder_force(*at))
    A = (basis[of][:, :, None] * columns[:, None, :]).reshape(target.size, -1)
    rows = [
        (basis[p][None, :, None] * G[:, None, :]).reshape(len(G), -1)
        for p, P in enumerate(PRESSURES)
        for G in [constraint_rows(constraint, order, P, path_end(P))]
    ]
    return A, target, np.concatenate(rows), of


@pytest.mark.parametrize("constraint", ["none", "positive", "slope", "drucker"])
@pytest.mark.parametrize("dependence", ["fixed", "linear", "free"])
def test_fits_agree_with_clarabel(swept, dependence, constraint):
    for order in (2, 3):
        A, target, G, _ = programme(dependence, constraint, order)
        found = row(swept, dependence, order, constraint)
        assert found.status is Status.OPTIMAL
        best = clarabel_objective(A, target, G, np.zeros(len(G)))
        assert found.objective == pytest.approx(best, rel=OBJECTIVE)
        assert found.kkt_residual < 1e-10
        assert found.duality_gap < 1e-8


@pytest.fixture(scope="module")
def averaged() -> Sweep:
    return sweep(DATA, geometry(), deadband=1e4, orders=(3,), objective="mean_rmse")


@pytest.mark.parametrize("constraint", ["none", "positive", "slope", "drucker"])
@pytest.mark.parametrize("dependence", ["fixed", "linear", "free"])
def test_the_mean_rmse_agrees_with_a_conic_programme(averaged, dependence, constraint):
    """Unknowns E, t; (t_p, A_p E - y_p) in a second-order cone, by Clarabel."""
    A, y, G, of = programme(dependence, constraint, 3)
    scale = np.abs(A).max(axis=0)
    A, G, n = A / scale, G / scale, A.shape[1]
    G /= np.maximum(np.linalg.norm(G, axis=1, keepdims=True), 1e-300)
    rows, right = [np.c_[-G, np.zeros((len(G), 3))]], [np.zeros(len(G))]
    cones: list = [clarabel.NonnegativeConeT(len(G))]
    for p in range(3):
        own = of == p
        top = np.r_[np.zeros(n), -np.eye(3)[p]]
        rows += [top[None], np.c_[-A[own], np.zeros((own.sum(), 3))]]
        right += [np.zeros(1), -y[own]]
        cones.append(clarabel.SecondOrderConeT(int(own.sum()) + 1))
    q = np.r_[np.zeros(n), 1 / np.sqrt(np.bincount(of)) / 3]
    none = np.zeros((n + 3, n + 3))
    best = solved(none, q, np.concatenate(rows), np.concatenate(right), cones)
    found = row(averaged, dependence, 3, constraint)
    assert found.status is Status.OPTIMAL
    assert found.objective == pytest.approx(float(best.obj_val), rel=OBJECTIVE)
    assert found.objective == pytest.approx(found.rmse, rel=1e-9)
    assert found.kkt_residual < 1e-10
    assert found.duality_gap < 1e-8


def test_a_perfect_law_is_found_by_either_objective():
    """Where the RMSE of every pressure has its corner."""
    for objective in ("sum_of_squares", "mean_rmse"):
        found = sweep(
            measured(noise=0.0), geometry(), deadband=1e4, orders=(3,), dependences=("fixed",),
            constraints=("none",), objective=objective,
        )  # fmt: skip
        (one,) = found.rows
        assert one.status is Status.OPTIMAL
        np.testing.assert_allclose(one.coefficients[0], SOFTENING, rtol=1e-6)


def test_nothing_is_violated_between_the_stations(swept):
    stable = [r for r in swept.rows if r.constraint == "drucker"]
    assert all(r.margin > -FEASIBLE * np.abs(r.coefficients).max() for r in stable)
    assert {r.verdict for r in stable} == {"stable"}
    assert row(swept, "fixed", 3, "none").verdict == "not stable"
    assert sum(abs(r.margin) < FEASIBLE * np.abs(r.coefficients).max() for r in stable) >= 2
    for r in swept.rows:
        if r.constraint == "slope":
            for E, P in zip(r.coefficients, PRESSURES, strict=True):
                G = constraint_rows("slope", r.order, float(P), path_end(float(P)))
                assert (G @ E).min() > -FEASIBLE * np.abs(E).max()


def test_scores(swept):
    """Written out for one fit, and the relations between fits."""
    found = row(swept, "linear", 3, "none")
    forces = []
    for E, P in zip(found.coefficients, PRESSURES, strict=True):
        muscle = famjax.Muscle(geometry(), famjax.PolynomialMaterial(E), 1e4)
        at = DATA.loaded & (DATA.pressure == P)
        forces.append(np.asarray(muscle.force(DATA.length[at], P)) - DATA.force[at])
        free, F = float(muscle.free_contraction(P)), DATA.force[at]
        contraction = 1 - DATA.length[at] / REST
        near = F / F.max() <= 0.1
        near = near if near.sum() > 2 else contraction > 0.185
        measured_free = np.polyfit(F[near], contraction[near], 1)[1]
        error = found.free_contraction_error_by_pressure[len(forces) - 1]
        assert error == pytest.approx(free - measured_free, abs=1e-4)  # 129 lengths, linear
    residual = np.concatenate(forces)
    np.testing.assert_allclose(found.rmse_by_pressure, [np.sqrt(np.mean(r**2)) for r in forces])
    assert found.mae == pytest.approx(np.mean([np.abs(r).mean() for r in forces]))
    n, k = residual.size, 7
    assert found.bic == pytest.approx(n * np.log(np.mean(residual**2)) + k * np.log(n))
    at_rest = (DATA.length == REST) & DATA.loaded
    blocked = [r[DATA.length[DATA.loaded & (DATA.pressure == P)] == REST][0] for r, P in
               zip(forces, PRESSURES, strict=True)]  # fmt: skip
    assert at_rest.sum() == 3
    np.testing.assert_allclose(found.blocked_error_by_pressure, blocked)
    for r in swept.rows:
        looser = row(swept, r.dependence, r.order, "none")
        assert r.objective >= looser.objective * (1 - 1e-12)
        assert np.isnan(r.cross_validated_rmse) == (r.dependence == "free")
        if r.dependence == "fixed":
            assert r.cross_validated_rmse > r.rmse


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"orders": (5,)}, "orders must be a whole number from 1 to 4"),
        ({"constraints": ("convex",)}, "constraints must be chosen from none"),
        ({"objective": "rmse"}, "objective must be chosen from sum_of_squares"),
        ({"deadband": -1.0}, "the deadband must be a gauge pressure"),
        ({"data": dataclasses.replace(DATA, length=DATA.length + 0.1)},
         "no reading is shorter than the rest length"),
    ],
)  # fmt: skip
def test_bad_options_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        sweep(**{"data": DATA, "geometry": geometry(), **change})
