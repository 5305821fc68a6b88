"""The force of a saved fit along a history: the static map and the hysteresis about it."""

from typing import Any

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import finite_or_none

from ..records.hysteresis import History
from ..saved.saved_fit import SavedFit
from .forces import NORMAL_95, model_forces, static_rows
from .slack import reported


def predict_history(fit: SavedFit, history: History) -> list[dict[str, Any]]:
    """What a saved muscle pulls at each point of a history, on whichever branch it is.

    The history begins where the cycles of the fitted records do: relaxed, and vented at the first
    length; after strokes, at the longest length under the first pressure. It may turn round at any
    reading, and moves one way between two of them.

    Args:
        fit: from `load_fit`, of `famjax assess --hysteresis`.
        history: lengths and pressures in the order of time.

    Returns:
        A row for each reading, as `predict` gives them, with `time_s` where there are times:
        `static_force_N` is that of the static map, `hysteresis_N` what the branch adds to it, and
        `force_N` their sum, 0 where the muscle is slack on that branch: `model_force_N` is the sum
        of the unclipped ones. Its error band is that of the static map, widened by
        `hysteresis_error`; `inside` is that of the static map.

    Raises:
        InputError: the fit has no hysteresis.
    """
    if fit.hysteresis is None:
        raise InputError(
            "the fit has no hysteresis, so that a history does not matter: fit raw ramps with "
            "famjax assess --hysteresis, or ask for lengths and pressures"
        )
    L, P = history.length, history.pressure
    added = np.asarray(fit.hysteresis.along(L, P), float)
    missed = hysteresis_error(fit)
    static = model_forces(fit, L, P)
    model, std = static.force + added, np.hypot(static.std, missed)
    half = np.hypot(static.half, NORMAL_95 * missed)
    # A slack reading of the static map says nothing of the upper branch.
    said = reported(model, half, np.zeros(L.size, bool), static.narrowest)
    found = []
    for k, row in enumerate(static_rows(fit, L, P)):
        time = {} if history.time is None else {"time_s": float(history.time[k])}
        found.append(
            time | {"length_m": row["length_m"], "pressure_Pa": row["pressure_Pa"],
                    "force_N": finite_or_none(said.force[k]), "static_force_N": row["force_N"],
                    "hysteresis_N": finite_or_none(added[k])}
            | row | {"force_N": finite_or_none(said.force[k]), "model_force_N": finite_or_none(model[k]),
                     "force_std_N": finite_or_none(std[k]), "low_95_N": finite_or_none(said.low[k]),
                     "high_95_N": finite_or_none(said.high[k]),
                     "slack": bool(said.slack[k]) if np.isfinite(model[k]) else None}
        )  # fmt: skip
    return found


def hysteresis_error(fit: SavedFit) -> float:
    """RMS error [N] of what the branches add: the largest on what was left out, or in sample.

    The error of half the branches' difference is that of either branch, as their mean is the static map.
    """
    entry = fit.document["hysteresis"]
    return max((one["rms_N"] for one in entry["left_out"].values()), default=entry["rms_N"])
