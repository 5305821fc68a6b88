"""Chapter 6, beyond the print: virtual work, -P dV/dL, instead of Gaylord's force."""

import functools

import numpy as np
from beside_print import Chapter, Row
from force_balance import balance, terms
from jaxtyping import Float
from specimen import bladder, inelastic_braid, latex, muscles

import famjax

chapter = Chapter(__name__)

# %% [markdown]
# # Chapter 6, beyond the print: virtual work instead of Gaylord's force
# Gaylord's force applies to a cylinder. For any shape, the force due to the pressure is -P dV/dL. If the
# threads stretch, the derivative is taken at constant thread length, because the work that stretches them
# is internal.

# %%
PRESSURE = 100.0


CONTRACTIONS = np.linspace(0, 0.35, 71)
"""Contractions in the range of the measured profiles."""

TABULATED = (0.0, 0.1, 0.2, 0.3, 0.35)

GAYLORD = "Gaylord force"

AT_PRESSURE = "-P dV/dL at constant pressure"

AT_THREAD_LENGTH = "-P dV/dL at constant thread length"
"""Names of the force due to pressure, for a cylinder and by virtual work. At constant thread length, the
work that stretches the threads is excluded."""


@functools.cache
def over_contraction() -> dict[str, dict[str, Float[np.ndarray, " contractions"]]]:
    """Return the pressure terms [lbf] of each geometry at `CONTRACTIONS`."""
    found = {}
    for name, muscle in muscles().items():
        at = balance(muscle, CONTRACTIONS, PRESSURE)
        found[name] = {term: at[term] for term in (GAYLORD, AT_PRESSURE, AT_THREAD_LENGTH)}
    return found


def _mean(values: Float[np.ndarray, " n"]) -> float:
    """Return the mean over the range of contraction."""
    return float(np.trapezoid(values, CONTRACTIONS) / np.ptp(CONTRACTIONS))


@chapter.table("force due to the pressure")
def work() -> list[Row]:
    """Return the pressure terms and their means over contraction.

    At constant pressure, the mean of the derivative over the range is exact, because it is the difference
    between two volumes. At a single contraction, the derivative is that of a spline through
    five profiles.
    """
    table, found = "virtual work", []
    for name, columns in over_contraction().items():
        for quantity, values in columns.items():
            for c in TABULATED:
                force = float(np.interp(c, CONTRACTIONS, values))
                entry = f"{name}, 100 psi, contraction {c:g}, {quantity}"
                found.append(Row(table, entry, force, "lbf"))
        gaylord, work = columns[GAYLORD], columns[AT_THREAD_LENGTH]
        blocked = work[0] + terms()[name].at("bladder force", -1, "rest")
        for entry, value in (
            *(
                (f"mean {quantity}, 0 to 35 %", _mean(values))
                for quantity, values in columns.items()
            ),
            ("mean absolute change in the pressure term, 0 to 35 %", _mean(np.abs(work - gaylord))),
            ("blocked force with -P dV/dL at constant thread length", blocked),
        ):
            found.append(Row(table, f"{name}, 100 psi, {entry}", float(value), "lbf"))
    return found


# %% [markdown]
# ## The work budget
# The work budget of a stroke from rest to 35 % contraction (or to zero force) has three parts: the work on
# the load, int F dL; the work of the fluid, int P dV; and the change in the energy of bladder and threads.
# A negative remainder is work that the force model creates from nothing.


# %%
@chapter.table("work in a stroke")
def strokes() -> list[Row]:
    """Return the work budget for every geometry, including the shape computed from mechanics."""
    tube, budgets = bladder(), {}
    shaped = famjax.EquilibriumMuscle(inelastic_braid(), tube, latex(), end_diameter=0.863)
    rest = float(tube.rest_length)
    for name, muscle in {**muscles(), "shape from mechanics": shaped}.items():
        for pressure in (100.0, 20.0):
            contraction = min(0.35, float(muscle.free_contraction(pressure)))
            end = rest * (1 - contraction)
            budgets[f"{name}, {pressure:g} psi"] = famjax.work_budget(muscle, pressure, rest, end)
    quantities = {
        "remainder / int P dV": ("left_over", ""),
        "int P dV": ("fluid", "in lbf"),
        "int F dL": ("load", "in lbf"),
        "stored in bladder and threads": ("stored", "in lbf"),
        "efficiency": ("efficiency", ""),
        "work per volume": ("density", "psi"),
    }
    return [
        Row("work of a stroke", f"{name}, {quantity}",
            float(getattr(one, field) / (one.fluid if field == "left_over" else 1)), unit)
        for quantity, (field, unit) in quantities.items()
        for name, one in budgets.items()
    ]  # fmt: skip
