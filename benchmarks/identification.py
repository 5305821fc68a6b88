"""Speed of the identification with its accuracy beside it, and everybody else's in the same run.

    python benchmarks/identification.py [folder] [task ...]

48 fits (four orders, three dependences on pressure, four constraints) of the SYNTHETIC
reconstruction under both objectives; bootstrap replicates; the cost of a gradient. Compilation, run
and gradient apart. The tasks are `sweeps`, `batches`, `gradients`, `joint` and `bootstrap`, by
default all; a line is printed as soon as it is known. Every solver sees the same rows. Times are
minima of repeated runs on the machine at hand: take ratios.
"""

import dataclasses
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("PJRT_NPROC", "16")

import identification_peers as peers
import jax
import jax.numpy as jnp
import numpy as np
from identification_page import EXACT
from identification_problem import ORDERS, Programme, programmes, shared
from jaxtyping import Array, Float, Int
from scipy import sparse

from fitting.convex import cholesky, inverse_lower, nearest_points
from fitting.sweeps.design import Design
from fitting.sweeps.fits import Fits, solve, solved
from fitting.sweeps.forms import CONSTRAINTS, DEPENDENCES, Forms
from fitting.sweeps.replicates import draw
from fitting.sweeps.unknowns import free

OBJECTIVES = ("sum_of_squares", "mean_rmse")
PEERS: dict[str, peers.Solver] = {
    "Clarabel, called directly": peers.clarabel_solver,
    "SLSQP, exact gradients": peers.slsqp,
    "SLSQP, finite differences": peers.slsqp_differences,
    "SLSQP, exact gradients, tolerance 1e-6 (its default)": peers.slsqp_by_default,
    "trust-constr, exact derivatives": peers.trust_constr,
}
TASKS = ("sweeps", "batches", "gradients", "joint", "bootstrap")
EVERY = {"trust-constr, exact derivatives": 12}
"""Solvers so slow that only every twelfth problem is given to them."""

_LONG_ENOUGH = 1.0  # seconds in which the machine is once left alone

MISSED = 1e-6
"""Relative distance from the optimum beyond which a fit counts as missed."""


@dataclasses.dataclass(frozen=True)
class Line:
    """One solver on one task.

    Attributes:
        task: what was solved.
        solver: by whom.
        seconds: of the fastest run.
        compile_seconds: of the first run, which compiles; nan for solvers that are not compiled.
        ratio: seconds over ours.
        error: largest relative difference from the polished optimum.
        missed: problems off by more than `MISSED`.
        problems: number of them.
        note: what else is to be known.
    """

    task: str
    solver: str
    seconds: float
    compile_seconds: float
    ratio: float
    error: float
    missed: int
    problems: int
    note: str = ""


def run(
    tasks: Sequence[str] = TASKS,
    *,
    n_pressures: int = 10,
    thin: int = 1,
    solvers: dict[str, peers.Solver] | None = None,
    replicates: tuple[int, ...] = (1000, 10000),
    repeats: int = 20,
) -> Iterator[Line]:
    """Lines as they are found.

    Args:
        tasks: some of `TASKS`.
        n_pressures: of the reconstruction.
        thin: take every so many-th reading.
        solvers: the others, None for all of them.
        replicates: sizes of the bootstrap batch.
        repeats: of our runs.
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError("the benchmark runs in float64: enable jax_enable_x64 first")
    unknown = sorted(set(tasks) - set(TASKS))
    if unknown:
        raise ValueError(f"tasks must be among {', '.join(TASKS)}, got {', '.join(unknown)}")
    _, _, of = shared(n_pressures, thin)
    if "sweeps" in tasks:
        for objective in OBJECTIVES:
            yield from sweeps(of, objective, PEERS if solvers is None else solvers, repeats)
    if "batches" in tasks:
        for count in replicates:
            yield from bootstrap(n_pressures, thin, count, repeats)
            yield from softening(count, repeats)
    if "gradients" in tasks:
        yield gradients(n_pressures, thin, repeats)
    if "joint" in tasks:
        yield from joint_lines()
    if "bootstrap" in tasks:
        yield from bootstrap_lines(replicates)


def sweeps(
    of: Design, objective: str, solvers: dict[str, peers.Solver], repeats: int
) -> Iterator[Line]:
    """The 48 fits under one objective, by everybody.

    Everybody poses the constraints at the stations; we then also make them exact between them.
    """
    task = f"48 fits, {objective.replace('_', ' ')}"
    problems, small = programmes(of, compressed=False), programmes(of, compressed=True)
    best = [peers.polished(one, objective)[0] for one in small]

    arrays = jax.tree.map(jnp.asarray, of)

    def fits(exchange: bool) -> tuple[Fits, float, float]:
        @jax.jit
        def fitted(of: Design) -> Fits:
            return solve(of, Forms(ORDERS), objective, exchange=exchange)[0]

        return _timed(fitted, arrays, repeats=repeats)

    ours, compiled, seconds = fits(False)
    errors = _errors(ours, small, best, objective)
    yield Line(
        task, "this project", seconds, compiled, 1.0, float(np.abs(errors).max()),
        int((np.abs(errors) > MISSED).sum()), errors.size,
        f"KKT residual {float(jnp.max(ours.kkt_residual)):.0e}",
    )  # fmt: skip
    exact, compiled, longer = fits(True)
    relative = float(jnp.max(jnp.abs(exact.objective / ours.objective - 1)))
    yield Line(
        task, EXACT, longer, compiled, longer / seconds, np.nan, int(jnp.sum(exact.status != 0)),
        errors.size,
        f"objectives higher by up to {relative:.0e}, which is what the stations let through",
    )  # fmt: skip
    for name, solver in solvers.items():
        yield _by(name, solver, task, objective, problems, small, best, seconds)


def _by(
    name: str,
    solver: peers.Solver,
    task: str,
    objective: str,
    problems: list[Programme],
    small: list[Programme],
    best: list[float],
    ours: float,
) -> Line:
    """A loop of a peer's solver over the problems, which are all of them or a part."""
    part = slice(None, None, EVERY.get(name, 1))
    problems, small, best = problems[part], small[part], best[part]
    # What a user would do once is not timed: Clarabel's sparse matrices of the compressed problem.
    conic = solver is peers.clarabel_solver
    given = [peers.conic(one, objective) for one in small] if conic else problems
    found, first, shortest = _timed(
        lambda: [solver(one, objective) for one in given], repeats=0 if name in EVERY else 2
    )
    spent = min(first, shortest) * EVERY.get(name, 1)
    pairs = list(zip(small, found, best, strict=True))
    off = np.array([abs(peers.value(one, x, objective) / value - 1) for one, x, value in pairs])
    outside = [-(one.G @ x).min() / np.linalg.norm(x) for one, x, _ in pairs if len(one.G)]
    missed = int((~(off <= MISSED)).sum())
    note = f"{len(problems)} calls, rows violated by {max(outside, default=0.0):.0e}"
    ratio = spent / ours
    return Line(task, name, spent, np.nan, ratio, float(np.nanmax(off)), missed, off.size, note)


def _errors(
    ours: Fits, problems: list[Programme], best: list[float], objective: str
) -> Float[np.ndarray, " fits"]:
    """Relative difference of our objectives from the polished ones, of the 48."""
    total: dict[tuple[str, int, str], list[float]] = {}
    for one, value in zip(problems, best, strict=True):
        total.setdefault(one.fit, []).append(value)
    together = np.mean if objective == "mean_rmse" else np.sum
    return np.array(
        [
            float(
                ours.objective[
                    DEPENDENCES.index(d), ORDERS.index(order), CONSTRAINTS.index(constraint)
                ]
            )
            / together(values)
            - 1
            for (d, order, constraint), values in total.items()
        ]
    )


def bootstrap(n_pressures: int, thin: int, count: int, repeats: int) -> list[Line]:
    """Replicates of the four-coefficient fit at one pressure whose stress has to rise."""
    _, readings, of = shared(n_pressures, thin)
    given = _replicates(of, draw(readings.there, count, (0,)))
    what = f"{count} bootstrap programmes of four coefficients"
    return _batch(what, *given, repeats=repeats)


def softening(count: int, repeats: int) -> list[Line]:
    """Programmes in which many rows enter and leave: a law that dips, through much noise."""
    rng, powers = np.random.default_rng(0), np.arange(1, 5)
    strain = rng.uniform(0, 1, 170)
    Q, R = np.linalg.qr(strain[:, None] ** powers)
    y = strain - 3 * strain**2 + 2.5 * strain**3 + 0.3 * rng.normal(size=(count, 170))
    weights = rng.exponential(size=(count, 170))
    H = np.einsum("ki,rk,kj->rij", Q, weights, Q, optimize=True)
    g = np.einsum("ki,rk,rk->ri", Q, weights, y, optimize=True)
    G = powers * np.linspace(0, 1, 17)[:, None] ** (powers - 1) @ np.linalg.inv(R)
    G = jnp.asarray(G / np.linalg.norm(G, axis=1)[:, None])
    task = f"{count} programmes of a law that softens"
    return _batch(task, G, jnp.zeros(17), jnp.asarray(H), jnp.asarray(g), repeats)


def _batch(
    task: str,
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    H: Float[Array, "r n n"],
    g: Float[Array, "r n"],
    repeats: int,
) -> list[Line]:
    """A batch of programmes that share their rows, by us and by Clarabel."""
    count = H.shape[0]
    found, compiled, seconds = _timed(jax.jit(_solve_batch), G, h, H, g, repeats=repeats)
    x, steps = (np.asarray(leaf) for leaf in found)
    some = slice(None, None, max(1, count // 200))
    rows = sparse.csc_matrix(np.asarray(G)[np.asarray(h) >= 0])
    sample = list(zip(np.asarray(H)[some], np.asarray(g)[some], x[some], strict=True))
    given = [peers.quadratic_conic(one, right, rows) for one, right, _ in sample]
    start = time.perf_counter()
    theirs = [peers.clarabel_solver(one) for one in given]
    spent = (time.perf_counter() - start) / len(theirs) * count
    off = []
    for (one, right, mine), other in zip(sample, theirs, strict=True):
        values = [v @ one @ v / 2 - right @ v for v in (mine, other)]
        off.append(abs(values[0] / values[1] - 1))
    note = (
        f"{seconds / count * 1e6:.2f} microseconds each; rows that entered or left: "
        f"{steps.mean():.2f} in the mean, {steps.max()} at most"
    )
    theirs_note = f"{spent / count * 1e6:.0f} microseconds each, of {len(theirs)} taken"
    missed = int((np.array(off) > MISSED).sum())
    return [
        Line(task, "this project", seconds, compiled, 1.0, max(off), missed, len(off), note),
        Line(
            task, "Clarabel, called directly", spent, np.nan, spent / seconds, np.nan, 0,
            len(off), theirs_note,
        ),
    ]  # fmt: skip


def _solve_batch(
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    H: Float[Array, "r n n"],
    g: Float[Array, "r n"],
) -> tuple[Float[Array, "r n"], Int[Array, " r"]]:
    J = jnp.swapaxes(inverse_lower(cholesky(H)), 1, 2)
    points = nearest_points(G, h, jnp.einsum("rnm,rn->rm", J, g), J)
    return jnp.einsum("rnm,rm->rn", J, points.y), points.steps


def _replicates(of: Design, weights: np.ndarray) -> tuple[Array, Array, Array, Array]:
    """Rows, Hessians and right-hand sides of the replicates, in whitened unknowns.

    Of the pressures that with the most active rows is taken.
    """
    unknowns = free(of, ORDERS[-1:])
    (found,) = solved(of, unknowns, ["slope"], np.ones((1, 1)), "sum_of_squares")
    pressure = int(np.argmax(found.fits.active))
    A = of.A[pressure] @ unknowns.on_y[pressure, 0]
    H = np.einsum("rk,kn,km->rnm", weights[:, pressure], A, A, optimize=True)
    g = np.einsum("rk,kn,k->rn", weights[:, pressure], A, of.target[pressure], optimize=True)
    G = found.fits.normals[pressure]
    h = np.where(np.any(G != 0, axis=1), 0.0, -1.0)
    return jnp.asarray(G), jnp.asarray(h), jnp.asarray(H), jnp.asarray(g)


def gradients(n_pressures: int, thin: int, repeats: int) -> Line:
    """The gradient of all coefficients, added up, in all forces: reverse mode."""
    _, readings, of = shared(n_pressures, thin)
    force = jnp.asarray(readings.force)

    def total(force: Float[Array, "p k"], of: Design) -> Float[Array, ""]:
        moved = dataclasses.replace(of, target=of.target + force - readings.force)
        found, _ = solve(moved, Forms(ORDERS), "sum_of_squares", exchange=False)
        return jnp.sum(found.coefficients)

    of = jax.tree.map(jnp.asarray, of)
    _, _, plain = _timed(jax.jit(total), force, of, repeats=repeats)
    slope, compiled, seconds = _timed(jax.jit(jax.grad(total)), force, of, repeats=repeats)
    direction = jnp.asarray(np.random.default_rng(0).normal(size=force.shape)) * readings.there
    value = jax.jit(total)
    central = (value(force + 1e-4 * direction, of) - value(force - 1e-4 * direction, of)) / 2e-4
    error = abs(float(jnp.sum(slope * direction) / central) - 1)
    return Line(
        "gradient of 48 fits in 1700 forces", "this project", seconds, compiled, seconds / plain,
        error, 0, 1, "ratio: to the fits alone; error: to a central difference",
    )  # fmt: skip


def _timed(function: Callable, *given: Any, repeats: int) -> tuple[Any, float, float]:
    """Result, seconds of the first run, and of the fastest of the next, which take a second.

    Args:
        function: what is timed.
        given: its arguments.
        repeats: runs after the first, at least; infinite seconds for none.
    """
    start = time.perf_counter()
    found = jax.block_until_ready(function(*given))
    first = time.perf_counter() - start
    fastest, until = float("inf"), time.perf_counter() + _LONG_ENOUGH * (repeats > 0)
    while repeats > 0 or time.perf_counter() < until:
        start = time.perf_counter()
        jax.block_until_ready(function(*given))
        fastest, repeats = min(fastest, time.perf_counter() - start), repeats - 1
    return found, first, fastest


def joint_lines() -> Iterator[Line]:
    """Joint identification of the bundled maps beside lmfit."""
    import identification_joint as joint  # noqa: PLC0415 -- lmfit is a benchmark's dependency

    for name in joint.MAPS:
        for row in joint.joint(name):
            yield Line(
                row["task"], row["solver"], row["seconds"], row.get("compile_seconds", np.nan),
                row.get("ratio", 1.0), np.nan, row.get("missed", 0), row["starts"],
                f"best RMSE {row['best_rmse_N']:.6g} N",
            )  # fmt: skip


def bootstrap_lines(replicates: tuple[int, ...]) -> Iterator[Line]:
    """Sweeps with the bootstrap of each of their fits, through the public call."""
    import identification_joint as joint  # noqa: PLC0415 -- lmfit is a benchmark's dependency

    for count in replicates:
        row = joint.sweep_bootstrap(count)
        yield Line(
            row["task"], row["solver"], row["seconds"], row["compile_seconds"], 1.0, np.nan, 0, 48,
            f"{row['microseconds_per_fit']:.1f} microseconds per fit",
        )  # fmt: skip


def peak_gflops() -> float:
    """Measured peak of double-precision arithmetic: a product of matrices of 1500."""
    A = np.random.default_rng(0).normal(size=(1500, 1500))
    best = np.inf
    for _ in range(5):
        start = time.perf_counter()
        _ = A @ A
        best = min(best, time.perf_counter() - start)
    return 2 * 1500**3 / best / 1e9


def main() -> None:
    """Print the lines of the tasks asked for, and write page and JSON."""
    from identification_page import write  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    given = sys.argv[1:]
    folder = Path(given.pop(0) if given and given[0] not in TASKS else "identification")
    lines = []
    for line in run(given or TASKS):
        lines.append(line)
        known = {k: v for k, v in vars(line).items() if v == v}  # noqa: PLR0124
        print(json.dumps(known), flush=True)
    for path in write(folder, lines, peak_gflops()):
        print("written:", path)


if __name__ == "__main__":
    main()
