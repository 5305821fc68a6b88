"""The force of a saved fit along a history: the static map and the hysteresis about it."""

from typing import Any

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import finite_or_none

from ..hysteresis.history_file import History
from ..saved.saved_fit import SavedFit
from .forces import NORMAL_95, static_rows


def predict_history(fit: SavedFit, history: History) -> list[dict[str, Any]]:
    """What a saved muscle pulls at each point of a history, on whichever branch it is.

    The history begins where the cycles of the fitted records do: relaxed, and vented at the first
    length; after strokes, at the longest length under the first pressure. It may turn round at any
    reading, and moves one way between two of them.

    Args:
        fit: from `load_fit`, of `famjax fit --hysteresis`.
        history: lengths and pressures in the order of time.

    Returns:
        A row for each reading, as `predict` gives them, with `time_s` where there are times:
        `static_force_N` is that of the static map, `hysteresis_N` what the branch adds to it, and
        `force_N` their sum. Its error band is that of the static map, widened by
        `hysteresis_error`; `slack` and `inside` are those of the static map.

    Raises:
        InputError: the fit has no hysteresis.
    """
    if fit.hysteresis is None:
        raise InputError(
            "the fit has no hysteresis, so that a history does not matter: fit raw ramps with "
            "famjax fit --hysteresis, or ask for lengths and pressures"
        )
    added = np.asarray(fit.hysteresis.along(history.length, history.pressure), float)
    missed = hysteresis_error(fit)
    rows = static_rows(fit, history.length, history.pressure)
    found = []
    for k, (row, extra) in enumerate(zip(rows, added.tolist(), strict=True)):
        time = {} if history.time is None else {"time_s": float(history.time[k])}
        static = row.pop("force_N")
        force = None if static is None else finite_or_none(static + extra)
        found.append(
            time | {"length_m": row["length_m"], "pressure_Pa": row["pressure_Pa"],
                    "force_N": force, "static_force_N": static,
                    "hysteresis_N": finite_or_none(extra)} | row | _band(force, row, missed)
        )  # fmt: skip
    return found


def hysteresis_error(fit: SavedFit) -> float:
    """RMS error [N] of what the branches add: the largest on what was left out, or in sample.

    The error of half the branches' difference is that of either branch, as their mean is the static map.
    """
    entry = fit.document["hysteresis"]
    return max((one["rms_N"] for one in entry["left_out"].values()), default=entry["rms_N"])


def _band(force: float | None, row: dict[str, Any], missed: float) -> dict[str, float | None]:
    """The error band of the static map about a force on a branch, with the error of the hysteresis."""
    std = row["force_std_N"]
    if force is None or std is None:
        return {"force_std_N": None, "low_95_N": None, "high_95_N": None}
    half = float(np.hypot((row["high_95_N"] - row["low_95_N"]) / 2, NORMAL_95 * missed))
    return {
        "force_std_N": float(np.hypot(std, missed)),
        "low_95_N": force - half,
        "high_95_N": force + half,
    }
