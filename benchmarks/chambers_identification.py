"""Chapter 7's printed errors beside fits of the SYNTHETIC reconstruction.

The work's isobars are not printed, so that nothing here can be expected to agree: the rows say how
far fits of the reconstruction are from what the work found on its own data. Objective: mean over
pressures of the RMSE, as in the work; measured geometry, no deadband; lbf and psi.
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from chambers_reference import Row, geometries, printed
from identification_problem import GEOMETRY, ORDERS, shared

from fitting._sweep_fits import solve_all
from fitting._sweep_lane import CONSTRAINTS, DEPENDENCES
from fitting._sweep_problem import Design
from fitting._sweep_scores import measured_ends, score

_MARK = "SYNTHETIC"


def rows() -> list[Row]:
    """Every printed error of chapter 7, and ours on the SYNTHETIC isobars; none has a tolerance."""
    return [*_constraints(), *_hocking(), *_third_order(), *_best_fit()]


@functools.cache
def _fits() -> dict[str, np.ndarray]:
    """Coefficients [psi] and scores [lbf] of the 48 fits, (dependences, orders, constraints, ...)."""
    data, readings, of = shared()
    geometry, zero = geometries()[GEOMETRY], jnp.zeros(())
    blocked, free = measured_ends(readings, data.specimen.rest_length)
    ends = (jnp.asarray(blocked), jnp.asarray(free))

    @eqx.filter_jit
    def both(of: Design) -> dict[str, jax.Array]:
        coefficients = solve_all(of, ORDERS, "mean_rmse")[0].coefficients
        # The work's own latex, as one more fit that is fixed in pressure and of third order.
        latex = jnp.asarray([*printed()["latex"]["E_psi"], 0.0])
        given = jnp.broadcast_to(latex, coefficients[:1, :1, :1].shape)
        own = score(of, geometry, zero, readings, coefficients, ORDERS, ends)
        theirs = score(of, geometry, zero, readings, given, ORDERS[:1], ends)
        names = ("rmse", "mae", "blocked_error", "free_contraction_error")
        return {
            "coefficients": coefficients,
            **{name: getattr(own, name) for name in names},
            **{f"latex_{name}": getattr(theirs, name)[0, 0, 0] for name in ("rmse", "mae")},
        }

    return {name: np.asarray(value) for name, value in both(of).items()}


def _of(name: str, dependence: str, order: int, constraint: str) -> Any:
    at = DEPENDENCES.index(dependence), ORDERS.index(order), CONSTRAINTS.index(constraint)
    return _fits()[name][at]


def _averages(
    table: str, label: str, of: tuple[str, int, str], published: dict[str, Any]
) -> list[Row]:
    """Mean absolute errors over pressures, where the work prints them."""
    figures = (
        ("blocked_error_lbf", "mean |blocked force error|", "blocked_error", "lbf"),
        ("free_contraction_error", "mean |free contraction error|", "free_contraction_error", "1"),
        ("mae_lbf", "mean MAE", "mae", "lbf"),
        ("rmse_lbf", "mean RMSE", "rmse", "lbf"),
    )
    return [
        Row(table, f"{_MARK}, {label}, {name}", float(np.abs(_of(ours, *of)).mean()), unit,
            published[key])
        for key, name, ours, unit in figures
    ]  # fmt: skip


def _constraints() -> list[Row]:
    """Table 7.2: fourth order, linear in pressure."""
    found = []
    for entry in printed()["constraint_result"]:
        constraint = "none" if entry["name"] == "free" else entry["name"]
        label = f"order 4, linear, {constraint}"
        found += _averages("7.2", label, ("linear", 4, constraint), entry)
    return found


def _hocking() -> list[Row]:
    """Fourth order, free at every pressure, no constraint."""
    label = "order 4, free in pressure, none"
    return _averages("7, Hocking", label, ("free", 4, "none"), printed()["hocking"])


def _third_order() -> list[Row]:
    """Tables 7.3 and 7.4: third order, fixed in pressure, beside the latex of chapter 6."""
    of, fit = printed()["fixed_third_order"], ("fixed", 3, "none")
    found = [
        Row("7.3", f"{_MARK}, order 3, fixed, E_{n + 1}", float(value), "psi", theirs)
        for n, (value, theirs) in enumerate(
            zip(_of("coefficients", *fit)[0], of["E_optimised_psi"], strict=False)
        )
    ]
    for name in ("mae", "rmse"):
        printed_of = of[f"{name}_lbf"]
        latex = float(_fits()[f"latex_{name}"].mean())
        ours = float(_of(name, *fit).mean())
        label = f"mean {name.upper()}"
        found.append(
            Row("7.4", f"{_MARK}, latex of chapter 6, {label}", latex, "lbf",
                printed_of["experimental"])
        )  # fmt: skip
        found.append(
            Row("7.4", f"{_MARK}, order 3, fixed, {label}", ours, "lbf", printed_of["optimised"])
        )
    return found


def _best_fit() -> list[Row]:
    """Table 7.6: third order, linear in pressure, Drucker's constraint."""
    of, fit = printed()["best_fit"], ("linear", 3, "drucker")
    _, readings, _ = shared()
    found = []
    figures = (
        ("blocked_error_lbf", "blocked force error", "blocked_error", "lbf"),
        ("free_contraction_error", "free contraction error", "free_contraction_error", "1"),
        ("rmse_lbf", "RMSE", "rmse", "lbf"),
        ("mae_lbf", "MAE", "mae", "lbf"),
    )
    for key, name, ours, unit in figures:
        values = dict(zip(readings.pressure.round(6), _of(ours, *fit), strict=True))
        for P, theirs in zip(of["pressure_psi"], of[key], strict=True):
            entry = f"{_MARK}, order 3, linear, drucker, {P} psi, {name}"
            found.append(Row("7.6", entry, float(values[P]), unit, theirs))
    for name in ("mae", "rmse"):
        mean = float(_of(name, *fit).mean())
        entry = f"{_MARK}, order 3, linear, drucker, mean {name.upper()}"
        found.append(Row("7.6", entry, mean, "lbf", of[f"total_{name}_lbf"]))
    return found
