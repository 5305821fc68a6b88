"""Promises of the verdict: wrong files end with exit code 1 and their cause, sound maps with 0."""

from collections.abc import Callable

from promise import Case, Promise

_SOUND, _SEED = 20, 0


def _of_all(figure: str) -> Callable[[Case], float]:
    """A figure of `wrong_files.py`, whose files are judged once for all of them."""

    def measure(case: Case) -> float:
        return case.once("wrong files", lambda: _measured(case))[figure]

    return measure


def _measured(case: Case) -> dict[str, float]:
    import wrong_files  # noqa: PLC0415

    given = [] if case.data is None else [case.name]
    return wrong_files.summary(list(wrong_files.rows(given, _SOUND, _SEED)))


def _row(figure: str, limit: float, direction: str = "at most") -> Promise:
    return Promise(
        14, f"the verdict: {figure}", _of_all(figure), "python benchmarks/wrong_files.py [--data MAP]",
        "bundled maps and random muscles", "20 sound maps; each mistake of file_faults.py in one",
        figure, limit, "at least" if direction == "at least" else "at most", seed=_SEED, cost="long",
    )  # fmt: skip


VERDICT: tuple[Promise, ...] = (
    _row("wrong files that end 0", 0.0),
    _row("wrong files whose cause is named, part", 0.7, "at least"),
    _row("sound maps that end 1", 0.0),
    _row("sound maps with a false cause", 1.0),
)
"""Issue 14."""
