"""Chapter 7, identification: the bladder law that the muscle's own isobars ask for."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from beside_print import Chapter, Row, Table, printed

import famjax
from fitting import ForceData, sweep
from fitting.sweeps import Sweep, SweepRow

chapter = Chapter(__name__)

# %% [markdown]
# # Chapter 7: identification
# With the latex law of a tensile test the model misses the tested isobars, so the chapter turns the
# question round: which E_n would make the model meet them? It fits laws of order 1 to 4, free, linear
# or fixed in pressure, under four constraints, 48 fits in the measured geometry; the objective is the
# mean over pressures of the RMSE. The work used a local solver. The force is linear in the E_n, so
# that each fit has one optimum, which `fitting.sweep` certifies.
#
# The tested isobars are not printed. Every figure below is of other isobars, those of the twin, or in
# `famjax reproduce` of a reconstruction: near the print, it says that the method is the same.


# %%
@dataclasses.dataclass(frozen=True)
class Isobars:
    """What the law is fitted to.

    Attributes:
        mark: put before every entry: what these isobars are.
        data: the readings.
        geometry: that the fits are made with.
        psi, lbf: in the units of both.
    """

    mark: str
    data: ForceData
    geometry: famjax.geometries.AbstractGeometry
    psi: float = 1.0
    lbf: float = 1.0

    def fits(self, dependence: str, order: int, *constraints: str) -> Sweep:
        """Fits by the work's objective, no deadband."""
        return sweep(
            self.data,
            self.geometry,
            orders=(order,),
            dependences=(dependence,),
            constraints=constraints,
            objective="mean_rmse",
        )

    def latex_errors(self) -> dict[str, float]:
        """Mean MAE and RMSE [lbf] of the latex law of chapter 6, which is not fitted."""
        law = famjax.PolynomialMaterial(jnp.array(printed()["latex"]["E_psi"]) * self.psi)
        data = self.data
        force = famjax.Muscle(self.geometry, law).force(data.length, data.pressure)
        residual = (np.asarray(force) - data.force) / self.lbf
        at = [residual[data.pressures.level == P] for P in np.unique(data.pressures.level)]
        return {
            "mae": float(np.mean([np.mean(np.abs(e)) for e in at])),
            "rmse": float(np.mean([np.sqrt(np.mean(e**2)) for e in at])),
        }


def averages(
    of: Isobars, table: str, label: str, fit: SweepRow, published: dict[str, Any]
) -> list[Row]:
    """Mean absolute errors over pressures, where the work prints them."""
    figures = (
        ("blocked_error_lbf", "mean |blocked force error|", fit.blocked_error / of.lbf, "lbf"),
        (
            "free_contraction_error",
            f"mean |free contraction error|{_where_free(fit)}",
            fit.free_contraction_error,
            "1",
        ),
        ("mae_lbf", "mean MAE", fit.mae / of.lbf, "lbf"),
        ("rmse_lbf", "mean RMSE", fit.rmse / of.lbf, "lbf"),
    )
    return [
        Row(table, f"{of.mark}, {label}, {name}", ours, unit, published[key])
        for key, name, ours, unit in figures
    ]


def _where_free(fit: SweepRow) -> str:
    """At how many pressures the fit's force falls to zero, where it is not all."""
    known = np.isfinite(fit.free_contraction_error_by_pressure)
    return "" if known.all() else f", at {known.sum()} of {known.size} pressures"


# %% [markdown]
# ## Table 7.2: what each constraint costs


# %%
def constraints(of: Isobars) -> list[Row]:
    """Table 7.2: fourth order, linear in pressure."""
    printed_rows = {
        "none" if entry["name"] == "free" else entry["name"]: entry
        for entry in printed()["constraint_result"]
    }
    found = []
    for fit in of.fits("linear", 4, *printed_rows).rows:
        label = f"order 4, linear, {fit.constraint}"
        found += averages(of, "7.2", label, fit, printed_rows[fit.constraint])
    return found


# %% [markdown]
# ## The most flexible law, after Hocking


# %%
def hocking(of: Isobars) -> list[Row]:
    """Fourth order, free at every pressure, no constraint."""
    label = "order 4, free in pressure, none"
    (fit,) = of.fits("free", 4, "none").rows
    return averages(of, "7, Hocking", label, fit, printed()["hocking"])


# %% [markdown]
# ## Tables 7.3 and 7.4: the latex of the tensile test against the law that fits


# %%
def third_order(of: Isobars) -> list[Row]:
    """Tables 7.3 and 7.4: third order, fixed in pressure, beside the latex of chapter 6."""
    theirs_all, (fit,) = printed()["fixed_third_order"], of.fits("fixed", 3, "none").rows
    found = [
        Row("7.3", f"{of.mark}, order 3, fixed, E_{n}", float(ours), "psi", theirs)
        for n, (ours, theirs) in enumerate(
            zip(fit.coefficients[0] / of.psi, theirs_all["E_optimised_psi"], strict=True), 1
        )
    ]
    latex = of.latex_errors()
    for name, fitted in (("mae", fit.mae), ("rmse", fit.rmse)):
        theirs, label = theirs_all[f"{name}_lbf"], f"mean {name.upper()}"
        for which, ours, key in (
            ("latex of chapter 6", latex[name], "experimental"),
            ("order 3, fixed", fitted / of.lbf, "optimised"),
        ):
            found.append(Row("7.4", f"{of.mark}, {which}, {label}", ours, "lbf", theirs[key]))
    return found


# %% [markdown]
# ## Table 7.6: the work's choice, third order, linear in pressure, Drucker-stable
# Table 7.5, which should hold its coefficients, repeats the rows of table 7.3.


# %%
def best_fit(of: Isobars) -> list[Row]:
    """Table 7.6: third order, linear in pressure, Drucker's constraint."""
    table, fits = printed()["best_fit"], of.fits("linear", 3, "drucker")
    (fit,) = fits.rows
    label = f"{of.mark}, order 3, linear, drucker"
    figures = (
        ("blocked_error_lbf", "blocked force error", fit.blocked_error_by_pressure / of.lbf, "lbf"),
        ("free_contraction_error", "free contraction error",
         fit.free_contraction_error_by_pressure, "1"),
        ("rmse_lbf", "RMSE", fit.rmse_by_pressure / of.lbf, "lbf"),
        ("mae_lbf", "MAE", fit.mae_by_pressure / of.lbf, "lbf"),
    )  # fmt: skip
    found = []
    for key, name, ours, unit in figures:
        at = dict(zip((fits.pressures[0] / of.psi).round(), ours, strict=True))
        for P, theirs in zip(table["pressure_psi"], table[key], strict=True):
            if P not in at:
                continue
            found.append(Row("7.6", f"{label}, {P} psi, {name}", float(at[P]), unit, theirs))
    for name, ours in (("mae", fit.mae), ("rmse", fit.rmse)):
        entry = f"{label}, mean {name.upper()}"
        found.append(Row("7.6", entry, ours / of.lbf, "lbf", table[f"total_{name}_lbf"]))
    return found


def tables(of: Isobars) -> tuple[Table, ...]:
    """Every printed error of the chapter, and ours on other isobars; none has a tolerance.

    Each is a sweep of its own, so that a reader sees how far the work is.
    """
    return (
        ("chapter 7, table 7.2: order 4, linear in pressure, each constraint",
         lambda: constraints(of)),
        ("chapter 7, section 7: order 4, free in pressure", lambda: hocking(of)),
        ("chapter 7, tables 7.3 and 7.4: order 3, fixed, beside the latex", lambda: third_order(of)),
        ("chapter 7, table 7.6: order 3, linear in pressure, Drucker", lambda: best_fit(of)),
    )  # fmt: skip
