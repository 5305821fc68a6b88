"""Chapter 7's printed errors beside fits of the SYNTHETIC reconstruction.

The work's isobars are not printed, so that nothing here can be expected to agree, and nothing has a
tolerance: the rows say how far fits of the reconstruction are from what the work found on its own
data. Objective: mean over pressures of the RMSE, as in the work; measured geometry, no deadband;
lbf and psi.
"""

from typing import Any

import numpy as np
from chambers_balance import balance
from chambers_reference import Row, Table, geometries, muscles, printed
from identification_problem import GEOMETRY, force_map

from fitting import sweep
from fitting.sweeps import Sweep, SweepRow

_MARK = "SYNTHETIC"


def tables() -> tuple[Table, ...]:
    """Every printed error of chapter 7, and ours on the SYNTHETIC isobars; none has a tolerance.

    Each is a sweep of its own, so that a reader sees how far the work is.
    """
    return (
        ("chapter 7, table 7.2: order 4, linear in pressure, each constraint", _constraints),
        ("chapter 7, section 7: order 4, free in pressure", _hocking),
        ("chapter 7, tables 7.3 and 7.4: order 3, fixed, beside the latex", _third_order),
        ("chapter 7, table 7.6: order 3, linear in pressure, Drucker", _best_fit),
    )


def _fits(dependence: str, order: int, *constraints: str) -> Sweep:
    """Fits of the SYNTHETIC isobars in the measured geometry, by the work's objective."""
    return sweep(
        force_map(),
        geometries()[GEOMETRY],
        orders=(order,),
        dependences=(dependence,),
        constraints=constraints,
        objective="mean_rmse",
    )


def _latex_errors() -> dict[str, float]:
    """Mean MAE and RMSE [lbf] of the latex law of chapter 6, which is not fitted."""
    data = force_map()
    rest = data.specimen.rest_length
    terms = balance(muscles()[GEOMETRY], 1 - data.length / rest, data.pressure)
    residual = terms["total force"] - data.force
    at = [residual[data.pressure == P] for P in np.unique(data.pressure)]
    return {
        "mae": float(np.mean([np.abs(e).mean() for e in at])),
        "rmse": float(np.mean([np.sqrt(np.mean(e**2)) for e in at])),
    }


def _averages(table: str, label: str, fit: SweepRow, published: dict[str, Any]) -> list[Row]:
    """Mean absolute errors over pressures, where the work prints them."""
    figures = (
        ("blocked_error_lbf", "mean |blocked force error|", fit.blocked_error, "lbf"),
        (
            "free_contraction_error",
            f"mean |free contraction error|{_where_free(fit)}",
            fit.free_contraction_error,
            "1",
        ),
        ("mae_lbf", "mean MAE", fit.mae, "lbf"),
        ("rmse_lbf", "mean RMSE", fit.rmse, "lbf"),
    )
    return [
        Row(table, f"{_MARK}, {label}, {name}", ours, unit, published[key])
        for key, name, ours, unit in figures
    ]


def _where_free(fit: SweepRow) -> str:
    """At how many pressures the fit's force falls to zero, where it is not all."""
    known = np.isfinite(fit.free_contraction_error_by_pressure)
    return "" if known.all() else f", at {known.sum()} of {known.size} pressures"


def _constraints() -> list[Row]:
    """Table 7.2: fourth order, linear in pressure."""
    printed_rows = {
        "none" if entry["name"] == "free" else entry["name"]: entry
        for entry in printed()["constraint_result"]
    }
    found = []
    for fit in _fits("linear", 4, *printed_rows).rows:
        label = f"order 4, linear, {fit.constraint}"
        found += _averages("7.2", label, fit, printed_rows[fit.constraint])
    return found


def _hocking() -> list[Row]:
    """Fourth order, free at every pressure, no constraint."""
    label = "order 4, free in pressure, none"
    (fit,) = _fits("free", 4, "none").rows
    return _averages("7, Hocking", label, fit, printed()["hocking"])


def _third_order() -> list[Row]:
    """Tables 7.3 and 7.4: third order, fixed in pressure, beside the latex of chapter 6."""
    of, (fit,) = printed()["fixed_third_order"], _fits("fixed", 3, "none").rows
    found = [
        Row("7.3", f"{_MARK}, order 3, fixed, E_{n}", float(ours), "psi", theirs)
        for n, (ours, theirs) in enumerate(
            zip(fit.coefficients[0], of["E_optimised_psi"], strict=True), 1
        )
    ]
    latex = _latex_errors()
    for name, fitted in (("mae", fit.mae), ("rmse", fit.rmse)):
        theirs, label = of[f"{name}_lbf"], f"mean {name.upper()}"
        for which, ours, key in (
            ("latex of chapter 6", latex[name], "experimental"),
            ("order 3, fixed", fitted, "optimised"),
        ):
            found.append(Row("7.4", f"{_MARK}, {which}, {label}", ours, "lbf", theirs[key]))
    return found


def _best_fit() -> list[Row]:
    """Table 7.6: third order, linear in pressure, Drucker's constraint."""
    of, fits = printed()["best_fit"], _fits("linear", 3, "drucker")
    (fit,) = fits.rows
    label = f"{_MARK}, order 3, linear, drucker"
    figures = (
        ("blocked_error_lbf", "blocked force error", fit.blocked_error_by_pressure, "lbf"),
        ("free_contraction_error", "free contraction error",
         fit.free_contraction_error_by_pressure, "1"),
        ("rmse_lbf", "RMSE", fit.rmse_by_pressure, "lbf"),
        ("mae_lbf", "MAE", fit.mae_by_pressure, "lbf"),
    )  # fmt: skip
    found = []
    for key, name, ours, unit in figures:
        at = dict(zip(fits.pressures[0].round(6), ours, strict=True))
        for P, theirs in zip(of["pressure_psi"], of[key], strict=True):
            found.append(Row("7.6", f"{label}, {P} psi, {name}", float(at[P]), unit, theirs))
    for name, ours in (("mae", fit.mae), ("rmse", fit.rmse)):
        entry = f"{label}, mean {name.upper()}"
        found.append(Row("7.6", entry, ours, "lbf", of[f"total_{name}_lbf"]))
    return found
