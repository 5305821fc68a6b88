"""Promises of speed once compiled, against solvers of other authors in the same run."""

from collections.abc import Callable, Iterable
from typing import Any

from promise import Case, Promise


def kernel(task: str, solver: str) -> Callable[[Case], float]:
    """Times faster than a solver on a task of `identification.py`; ours in ms for ""."""

    def measure(case: Case) -> float:
        from identification_page import EXACT  # noqa: PLC0415

        lines = case.once(("kernel", task), lambda: _kernel_lines(task))
        seconds = {line.solver: line.seconds for line in lines}
        ours = seconds[EXACT if solver.startswith("exact:") else _ours(seconds)]
        other = solver.removeprefix("exact:")
        return 1e3 * ours if not other else seconds[other] / ours

    return measure


def _ours(seconds: dict[str, float]) -> str:
    return next(name for name in seconds if name.startswith("this project"))


def _kernel_lines(task: str) -> list[Any]:
    import identification  # noqa: PLC0415 -- Clarabel, and float64 switched on
    import jax  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    if task.startswith("joint"):
        lines = list(identification.run(["joint"]))
    elif "programmes" in task:
        lines = list(identification.run(["batches"], replicates=(10000,)))
    else:
        _, _, of = identification.shared(10, 1)
        wanted = ("Clarabel, called directly", "SLSQP, exact gradients",
                  "SLSQP, finite differences")  # fmt: skip
        solvers = {name: identification.PEERS[name] for name in wanted}
        objective = task.removeprefix("48 fits, ").replace(" ", "_")
        lines = list(identification.sweeps(of, objective, solvers, 20))
    return [line for line in lines if line.task == task]


def _kernels() -> Iterable[Promise]:
    squares, mean = "48 fits, sum of squares", "48 fits, mean rmse"
    rows: list[tuple[int, str, str, str, float]] = [
        (12, squares, "", "wall time [ms]", 1.2),
        (12, squares, "SLSQP, exact gradients", "times faster", 150),
        (4, squares, "SLSQP, finite differences", "times faster", 1000),
        (12, squares, "Clarabel, called directly", "times faster", 10),
        (12, squares, "exact:SLSQP, exact gradients", "times faster, exact between stations", 60),
        (4, mean, "SLSQP, exact gradients", "times faster", 80),
        (4, "10000 bootstrap programmes of four coefficients", "Clarabel, called directly",
         "times faster", 50),
        *((12, f"joint identification of {name}, 16 starts", "lmfit, least squares by differences",
           "times faster, compiled", 5) for name in ("DMSP-20-300", "DMSP-10-250")),
    ]  # fmt: skip
    for issue, task, solver, statistic, limit in rows:
        name = f"kernel, {task}{', ' * bool(solver)}{solver.replace('exact:', 'exact, ')}"
        yield Promise(
            issue, name, kernel(task, solver), "python benchmarks/identification.py",
            "maps" if task.startswith("joint") else "SYNTHETIC reconstruction",
            "shortest of repeated runs", statistic, limit, "at least" if solver else "at most",
        )  # fmt: skip


KERNELS: tuple[Promise, ...] = tuple(_kernels())
"""Issues 4 and 12."""
