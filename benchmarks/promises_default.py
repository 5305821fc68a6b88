"""Promises of the default answer: never silently wrong between the readings, and 0 N where it is slack."""

from collections.abc import Callable, Iterator

from dense_truth import Group
from promise import Case, Promise
from promises_choice import chosen

import fitting

_MAPS = "python benchmarks/silent_errors.py --group"


def _of_group(group: Group, figure: str) -> Callable[[Case], float]:
    """A figure of `silent_errors.py`, whose maps are examined once for all of them."""

    def measure(case: Case) -> float:
        import silent_errors  # noqa: PLC0415
        from dense_truth import maps  # noqa: PLC0415

        found = case.once(
            ("silent errors", group),
            lambda: silent_errors.summary([*silent_errors.examine(maps(group))])[group],
        )
        return found[figure]

    return measure


def slack_readings_without_zero(case: Case) -> float:
    """Slack readings whose 95 % band does not contain 0 N."""
    from slack_states import saved, slack_states  # noqa: PLC0415

    found = slack_states(saved(chosen(case)), case.map)
    return float(found.readings - found.contained)


def place_of_the_choice(case: Case) -> float:
    """Place of the choice in the league table by interior lengths left out, 1 for the first."""
    rows = case.once("league table", lambda: fitting.compare(case.map)).rows
    return 1.0 + [row.name for row in rows].index("famjax_choice")


def _rows() -> Iterator[Promise]:
    about = {
        "own": "60 random muscles of a physics written apart, in ordinary laboratories",
        "hard": "24 such muscles that fit the map of the DMSP-10-250",
        "bundled": "both bundled maps thinned and with noise; the truth is the fit of the whole",
    }
    limits: tuple[tuple[Group, str, float, str], ...] = (
        ("own", "silently wrong", 0.0, "at most"),
        ("own", "mean RMSE, %", 0.5, "at most"),
        ("own", "mean half-band, %", 2.2, "at most"),
        ("hard", "bad", 1.0, "at most"),
        ("hard", "mean coverage, %", 95.0, "at least"),
        ("bundled", "silently wrong", 0.0, "at most"),
        ("bundled", "worst error, half-bands", 2.0, "at most"),
    )
    for group, figure, limit, direction in limits:
        yield Promise(
            14, f"default answer, {group}: {figure}", _of_group(group, figure), f"{_MAPS} {group}",
            about[group], "states inside the measured range", figure, limit,
            "at least" if direction == "at least" else "at most", seed=0, cost="long",
        )  # fmt: skip
    for data in fitting.bundled_names():
        yield Promise(
            14, "slack readings without 0 N in their band", slack_readings_without_zero,
            "python benchmarks/slack_states.py", data, "slack readings", "number of readings", 0.0,
            seed=0,
        )  # fmt: skip
        yield Promise(
            14, "place of the choice among all models", place_of_the_choice, "famjax compare MAP.csv",
            data, "loaded readings of interior lengths, while each was left out",
            "place by RMSE, 1 for the first", 1.0, seed=0, cost="long",
        )  # fmt: skip


DEFAULT: tuple[Promise, ...] = tuple(_rows())
