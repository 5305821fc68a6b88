"""Speed of identification beside named peers in the same run, accuracy beside it.

Times are the shortest of repeated runs: take ratios, on a machine that does nothing else.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import reconstruction
from fits import Matrix, Vector, clarabel, columns, constraint_rows
from row import Case
from scipy import optimize

import famjax
import fitting
from fitting.specimen import any_units

BATCH, SAMPLE = 10_000, 200


def shortest(call: Callable[[], Any], repeats: int) -> float:
    """Wall time [s] of the fastest of so many calls."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return min(times)


def batch(case: Case) -> dict[str, float]:
    """10 000 programmes of four coefficients whose stress has to rise, by the convex core compiled.

    The readings of one pressure of the reference work's SYNTHETIC reconstruction, drawn anew by noise of
    1 % and compressed by QR; every solver gets the same rows, the others in a loop over 200. SLSQP, which
    does what the work's fmincon does, has exact gradients and a tolerance of 1e-12.
    """
    import jax  # noqa: PLC0415 -- after the number of its threads is set

    A, b, G = programme()
    noise = 0.01 * np.abs(b).max() * np.random.default_rng(0).normal(size=(BATCH, b.size))
    solve = jax.jit(jax.vmap(lambda b: fitting.convex.solve_qp(A, b, G, np.zeros(len(G))).x))
    targets = b + noise
    x = np.asarray(solve(targets))
    ours = shortest(lambda: jax.block_until_ready(solve(targets)), 3 * case.repeat) / BATCH
    calls = [clarabel(A, one, G) for one in targets[:SAMPLE]]
    rows = {"type": "ineq", "fun": lambda x: G @ x, "jac": lambda _: G}

    def value(x: Vector, b: Vector) -> float:
        return 0.5 * float(np.sum((A @ x - b) ** 2))

    def slsqp(b: Vector) -> Vector:
        scale, start = 1 / value(np.zeros(4), b), np.full(4, 1e-3 * np.abs(b).max())
        return optimize.minimize(
            lambda x: scale * value(x, b), start, jac=lambda x: scale * A.T @ (A @ x - b),
            method="SLSQP", constraints=[rows], options={"maxiter": 500, "ftol": 1e-12},
        ).x  # fmt: skip

    conic = shortest(lambda: [call() for call in calls], case.repeat) / SAMPLE
    local = shortest(lambda: [slsqp(one) for one in targets[:SAMPLE]], case.repeat) / SAMPLE
    pairs, none = zip(x, targets, calls, strict=False), np.zeros(4)
    return {
        "times faster than Clarabel, called directly": conic / ours,
        "times faster than SLSQP, exact gradients": local / ours,
        "largest relative difference of the objective from Clarabel's": max(
            abs(1 - (value(mine, one) - value(none, one)) / (value(call(), one) - value(none, one)))
            for mine, one, call in pairs
        ),
    }


@any_units()
def programme() -> tuple[Matrix, Vector, Matrix]:
    """Columns, target and constraint of one pressure, columns and rows of unit length."""
    data, geometry = reconstruction.force_map(), reconstruction.measured_geometry()
    pressure = np.unique(data.pressure)[3]
    at = data.pressure == pressure
    A, rest = columns(geometry, 0.0, data.length[at], data.pressure[at], 4)
    size = np.linalg.norm(A, axis=0)
    G = (
        constraint_rows(geometry, "slope", float(data.length[at].min()), float(pressure), 4, 17)
        / size
    )
    R: Any = np.linalg.qr(np.column_stack([A / size, data.force[at] - rest]), mode="r")
    return R[:, :-1], R[:, -1], G / np.linalg.norm(G, axis=1, keepdims=True)


def joint(case: Case, starts: int = 16) -> dict[str, float]:
    """Cubic law, two numbers of the braid and the deadband, by us and by lmfit from the same box.

    lmfit gets the same force, compiled, the same six parameters, bounds and number of starts, and no
    constraint, which it has no form for.
    """
    import jax  # noqa: PLC0415
    import lmfit  # noqa: PLC0415 -- a dependency of the benchmarks

    def identified() -> fitting.Identification:
        return fitting.identify(case.map, order=3, constraint="none", starts=starts)

    ours = identified()
    seconds = shortest(identified, case.repeat)
    data, at, geometry = ours.data, ours.data.loaded, getattr(ours.muscle, "geometry", None)
    assert isinstance(geometry, famjax.EstimatedGeometry)
    bladder, thickness = geometry.bladder, geometry.braid.thickness
    names = ("braid_diameter", "braid_angle", "deadband_pressure")

    @jax.jit
    def residual(diameter: Any, angle: Any, deadband: Any, E: Any) -> Any:
        braid = famjax.Braid.from_rest(
            diameter=diameter, braid_angle=angle, length=bladder.rest_length, thickness=thickness
        )
        shape = famjax.EstimatedGeometry(braid, bladder)
        muscle = famjax.Muscle(shape, famjax.PolynomialMaterial(E), deadband)
        return muscle.force(data.length[at], data.pressure[at]) - data.force[at]

    def of(p: Any) -> Vector:
        v = p.valuesdict()
        return np.asarray(
            residual(*(v[n] for n in names), np.array([v["E_1"], v["E_2"], v["E_3"]]))
        )

    rng, reached = np.random.default_rng(0), []
    begin = time.perf_counter()
    for _ in range(starts):
        parameters = lmfit.Parameters()
        for name in names:
            low, high = ours.estimate(name).min, ours.estimate(name).max
            parameters.add(name, value=rng.uniform(low, high), min=low, max=high)
        for n in (1, 2, 3):
            parameters.add(f"E_{n}", value=1e6 * rng.normal())
        fit = lmfit.minimize(of, parameters)
        reached.append(float(np.sqrt(np.mean(fit.residual**2))))
    return {
        "times faster than lmfit, 16 starts": (time.perf_counter() - begin) / seconds,
        "RMSE / the best of lmfit": ours.errors.rmse / min(reached),
    }
