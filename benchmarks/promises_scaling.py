"""Promises of large work: the same numbers on every engine, at the rate of one chunk."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from promise import Case, Direction, Promise, shown

_PROGRAMMES, _PICTURES = 1_000_000, 400


def _of_the_bootstrap(figure: str) -> Callable[[Case], float]:
    def measure(case: Case) -> float:
        from scaling import measured  # noqa: PLC0415

        return case.once("scaling", lambda: measured(_PROGRAMMES))[figure]

    return measure


def _of_pictures(case: Case) -> float:
    from imaging_speed import campaign  # noqa: PLC0415

    del case
    with tempfile.TemporaryDirectory() as folder:
        rates = campaign(Path(folder), _PICTURES)
    return rates["2 workers"] / rates["1 workers"]


def _row(
    name: str, figure: str, statistic: str, limit: float, direction: Direction = "at most"
) -> Promise:
    return Promise(
        18, name, _of_the_bootstrap(figure), "python benchmarks/scaling.py --programmes 1e6",
        "DMSP-20-300", f"{_PROGRAMMES:g} bootstrap programmes of the reference sweep", statistic,
        limit, direction, 0,
    )  # fmt: skip


SCALING: tuple[Promise, ...] = (
    _row("memory of a million programmes", "rss_B", "largest memory of a process [B]", 2 * 2.0**30),
    _row("rate of a million programmes", "of_the_rate_of_one_chunk", "share of the rate of one chunk",
         0.8, "at least"),
    _row("a million programmes take their share of time", "nonlinearity",
         "largest departure of a quarter, half, three quarters", 0.1),
    _row("two processes, fits", "two_processes_over_one", "rate over that of one process", 1.6,
         "at least"),
    Promise(18, "two processes, pictures", _of_pictures,
            f"python benchmarks/imaging_speed.py --pictures {_PICTURES}", "rendered crops",
            f"{_PICTURES} pictures of 2650 x 1100 px", "rate over that of one process", 1.7, "at least"),
    shown(18, "workers and client killed: the same bytes",
          "pytest tests/famjax/boundary/tasks/test_kills.py", "failed tests", 0.0),
    shown(18, "one script on every engine", "python examples/engines.py", "engines that differ", 0.0),
)  # fmt: skip
