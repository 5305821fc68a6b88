"""The force of a saved fit along a history: the static map and the hysteresis about it."""

from typing import Any

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import finite_or_none

from ..hysteresis.history_file import History
from .prediction import static_rows
from .saved_fit import SavedFit


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
        `force_N` their sum. Its error band, `slack` and `inside` are those of the static map.

    Raises:
        InputError: the fit has no hysteresis.
    """
    if fit.hysteresis is None:
        raise InputError(
            "the fit has no hysteresis, so that a history does not matter: fit raw ramps with "
            "famjax fit --hysteresis, or ask for lengths and pressures"
        )
    added = np.asarray(fit.hysteresis.along(history.length, history.pressure), float)
    rows = static_rows(fit, history.length, history.pressure)
    found = []
    for k, (row, extra) in enumerate(zip(rows, added.tolist(), strict=True)):
        time = {} if history.time is None else {"time_s": float(history.time[k])}
        static = row.pop("force_N")
        force = None if static is None else finite_or_none(static + extra)
        ends = {
            end: None if row[end] is None else finite_or_none(row[end] + extra)
            for end in ("low_95_N", "high_95_N")
        }
        found.append(
            time | {"length_m": row["length_m"], "pressure_Pa": row["pressure_Pa"],
                    "force_N": force, "static_force_N": static,
                    "hysteresis_N": finite_or_none(extra)} | row | ends
        )  # fmt: skip
    return found
