"""Chapter 5, the elastic braid: how much the threads stretch at the resting length."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from beside_print import Chapter, Row, beside, printed
from jaxtyping import Array, Float
from specimen import PRESSURES, elastic_braid

from famjax import units
from famjax.braids import (
    braid_angle_from_length,
    diameter_from_length,
    gaylord_force,
    thread_tension,
)
from famjax.compile_options import quick_jit

chapter = Chapter(__name__)


# %% [markdown]
# # Chapter 5: the elastic braid
# Photographs of the blocked muscle show that its diameter grows with pressure, from 1.001 in at rest to
# 1.044 in at 100 psi. A braid of inextensible threads cannot expand at constant length, so the threads
# stretch. The chapter determines how much they stretch, and how this affects the angle and the force. The
# printed diameters and blocked forces are used here.
#
# ## The threads


# %%
@chapter.table("section 5: thread area")
def area() -> list[Row]:
    of = printed()["specimen"]
    area = of["fibres_per_thread"] * np.pi * of["fibre_diameter_in"] ** 2 / 4
    return [beside("5, thread", "area of the fibres", area, "in2", "specimen.thread_area_in2")]


# %% [markdown]
# ## Table 5.1: from the printed diameters
# With L = B sin(theta) and pi N D = B cos(theta), each diameter determines a thread length and an angle.
# The tension in a thread, (F + P pi R^2)/(n sin theta), follows from the force balance.

# %%
HIGH_PRESSURE = 80.0
"""Lowest pressure [psi] in the high-pressure fit; the reference work does not state its choice."""

DIGIT = 0.0005
"""Half a unit in the last digit of the printed diameters [in]."""

WHY = "half a unit in the last digit of the printed diameters"


class InSitu(NamedTuple):
    """State of the threads at each printed pressure, in SI units, and their moduli.

    Attributes:
        thread_length: B [m].
        braid_angle: theta [rad].
        strain: B / B0 - 1 [-], where B0 is the length without pressure.
        tension: tension in one thread [N].
        moduli: slopes of stress against strain [Pa]: through the origin, and at high pressure.
    """

    thread_length: np.ndarray
    braid_angle: np.ndarray
    strain: np.ndarray
    tension: np.ndarray
    moduli: np.ndarray


def in_situ(change: float | np.ndarray = 0.0) -> InSitu:
    """Return the threads' state at the printed diameters and tested blocked forces.

    Args:
        change: change in the printed diameters [in].
    """
    of, table = printed()["specimen"], printed()["elastic_braid"]
    tested = printed()["tested"]
    force = dict(zip(tested["pressure_psi"], tested["blocked_force_lbf"], strict=True)) | {0: 0}
    F = np.array([force[P] for P in table["pressure_psi"]]) * units.LBF
    D, P = (np.array(table["D_in"]) + change) * units.INCH, np.array(table["pressure_psi"])
    L = of["active_length_in"] * units.INCH
    B = np.hypot(L, np.pi * of["turns_N"] * D)
    strain = B / B[P == 0].mean() - 1
    tension = (F + P * units.PSI * np.pi * D**2 / 4) * B / (of["threads"] * L)
    stress = tension / (of["thread_area_in2"] * units.INCH**2)
    high = P >= HIGH_PRESSURE
    moduli = strain @ stress / (strain @ strain), np.polyfit(strain[high], stress[high], 1)[0]
    return InSitu(B, np.arcsin(L / B), strain, tension, np.array(moduli))


@chapter.table("table 5.1: threads at the printed diameters")
def from_diameters() -> list[Row]:
    state, wider, found = in_situ(), in_situ(DIGIT), []
    columns = (
        ("B", "in", state.thread_length / units.INCH, wider.thread_length / units.INCH),
        ("theta", "deg", np.rad2deg(state.braid_angle), np.rad2deg(wider.braid_angle)),
    )
    for k, P in enumerate(printed()["elastic_braid"]["pressure_psi"]):
        for symbol, unit, of, changed in columns:
            entry, key = (
                f"{symbol} from the printed D, {P} psi",
                f"elastic_braid.{symbol}_{unit}.{k}",
            )
            found.append(beside("5.1", entry, of[k], unit, key, abs(changed[k] - of[k]), WHY))
    tension, strain = float(state.tension.max() / units.LBF), float(state.strain.max())
    rest, stretched = state.thread_length.min(), state.thread_length.max()
    # Diameters at both ends of the strain interval.
    spread = float(wider.thread_length.max() - stretched + wider.thread_length.min() - rest) / rest
    return [
        *found,
        beside("5.1", "largest thread tension", tension, "lbf", "elastic_braid.max_thread_tension_lbf"),
        beside("5.1", "largest thread strain", strain, "1", "elastic_braid.max_thread_strain",
               spread, WHY),
    ]  # fmt: skip


# %% [markdown]
# ## The modulus in situ
# The modulus is the slope of the threads' stress-strain curve. The reference work lists two moduli. One is
# the slope of a line through the origin and all points, as the model B = B0 (1 + T/(A_b E_b)) requires. The
# other is the slope of the points at high pressure, beyond the toe region.


# %%
@chapter.table("section 5: moduli in situ")
def moduli() -> list[Row]:
    def both(change: float | np.ndarray = 0.0) -> np.ndarray:
        return in_situ(change).moduli / units.PSI

    found = both()
    each = np.eye(len(printed()["elastic_braid"]["D_in"])) * DIGIT
    spread = sum(np.abs(both(change) - found) for change in each)
    entries = (
        ("in-situ modulus, line through the origin, all points in table 5.1", "linear"),
        (
            f"in-situ modulus, points in table 5.1 from {HIGH_PRESSURE:g} psi upwards",
            "high_pressure",
        ),
    )
    return [
        beside("5, thread", entry, modulus, "psi", f"specimen.thread_modulus_in_situ_{name}_psi",
               float(size), WHY)
        for (entry, name), modulus, size in zip(entries, found, np.ravel(spread), strict=True)
    ]  # fmt: skip


# %% [markdown]
# ## Table 5.1 again: the elastic braid as a model
# Here the modulus is the only input. Tension stretches the thread, and the stretch changes the angle and
# the tension, so B is the solution of an equation. The result is compared with the photographed diameters.

# %%
SWEPT = np.linspace(0, 100, 51)
"""Gauge pressures [psi] in the sweep, including those in tables 5.1 and 5.2."""


def _at(pressure: float) -> int:
    """Return the index of a pressure [psi] in `SWEPT`."""
    return SWEPT.tolist().index(pressure)


class BraidState(NamedTuple):
    """State of a braid at a length and pressure under Gaylord's force, in inches, radians and lbf."""

    thread_length: Array
    diameter: Array
    braid_angle: Array
    gaylord_force: Array
    tension: Array  # in one thread


class BraidStretch(NamedTuple):
    """States of the same braid with and without stretch of its threads."""

    elastic: BraidState
    inelastic: BraidState


@quick_jit
def _stretched(
    softness: Float[Array, ""],
    length: Float[Array | np.ndarray, "..."],
    pressure: Float[Array | np.ndarray, " n"],
) -> BraidStretch:
    braid = elastic_braid(softness)
    L, P = jnp.broadcast_arrays(jnp.asarray(length), jnp.asarray(pressure))

    def state(thread_length: Array) -> BraidState:
        diameter = diameter_from_length(L, thread_length, braid.turns)
        angle = braid_angle_from_length(L, thread_length)
        force = gaylord_force(P, diameter / 2, angle)
        tension = thread_tension(force, P, diameter / 2, angle, braid.n_threads)
        return BraidState(thread_length, diameter, angle, force, tension)

    rest = jnp.broadcast_to(braid.rest_thread_length, L.shape)
    return BraidStretch(state(braid.thread_length(L, P)), state(rest))


@functools.cache
def stretch(softness: float = 1.0) -> BraidStretch:
    """Return the braid at its resting length and the pressures `SWEPT`, with and without stretch."""
    rest = np.asarray(printed()["specimen"]["active_length_in"])
    return jax.tree.map(np.asarray, _stretched(jnp.asarray(softness), rest, SWEPT))


@chapter.table("table 5.1: the elastic braid")
def model() -> list[Row]:
    """Compare the model with the photographed diameters."""
    pixel = 1 / printed()["photogrammetry"]["scale_px_per_in"]
    return [
        beside("5.1", f"D from the model, {P} psi", float(stretch().elastic.diameter[_at(P)]), "in",
               f"elastic_braid.D_in.{k}", pixel, "one pixel in the photographs")
        for k, P in enumerate(printed()["elastic_braid"]["pressure_psi"])
    ]  # fmt: skip


# %% [markdown]
# ## Table 5.2: with and without stretch, and a braid ten times softer

# %%
SOFT = 10.0
"""Ratio of the stiffness of Kevlar to that of the soft braid."""

BRAIDS = (("5.2", "", 1.0), ("5, soft braid", "soft braid, ", SOFT))
"""Table, label and softness of each braid that is listed with and without stretch."""


def _columns(state: BraidState) -> dict[str, tuple[str, np.ndarray]]:
    """Return the unit and values of each quantity in a braid's table."""
    return {
        "B": ("in", np.asarray(state.thread_length)),
        "D": ("in", np.asarray(state.diameter)),
        "theta": ("deg", np.rad2deg(np.asarray(state.braid_angle))),
        "Gaylord's force": ("lbf", np.asarray(state.gaylord_force)),
        "thread tension": ("lbf", np.asarray(state.tension)),
    }


@chapter.table("table 5.2: with and without stretch")
def stretched() -> list[Row]:
    """Return table 5.2, and the same table for the soft braid."""
    found = []
    for table, label, softness in BRAIDS:
        both = stretch(softness)
        for name, state in (("with stretch", both.elastic), ("without stretch", both.inelastic)):
            found += [
                Row(table, f"{label}{quantity} {name}, {P:g} psi", float(values[_at(P)]), unit)
                for P in (0.0, *PRESSURES)
                for quantity, (unit, values) in _columns(state).items()
            ]
    return found


@chapter.table("table 5.2: effects of the elastic braid")
def changes() -> list[Row]:
    """Return the effect of thread stretch at rest and at the tested free contraction."""
    tested, rest = printed()["tested"], printed()["specimen"]["active_length_in"]
    free = rest * (1 - np.array(tested["free_contraction"]))
    lengths = np.stack([np.full_like(free, rest), free])
    found = []
    for table, label, softness in BRAIDS:
        both = _stretched(jnp.asarray(softness), lengths, np.array(tested["pressure_psi"], float))
        before, after = _columns(both.inelastic), _columns(both.elastic)
        for place, state in enumerate(("at rest", "at the tested free contraction")):
            for k, P in enumerate(tested["pressure_psi"]):
                for quantity, (unit, values) in after.items():
                    was = float(before[quantity][1][place, k])
                    change = float(values[place, k]) - was
                    entry = f"{label}change in {quantity} due to the elastic braid {state}, {P} psi"
                    found += [
                        Row(table, entry, change, unit),
                        Row(table, f"{entry}, relative to the inelastic braid", change / was, "1"),
                    ]
    return found


# %% [markdown]
# ## Strength margin of the threads


# %%
@chapter.table("section 5: strength of the threads")
def strength() -> list[Row]:
    """Return the ratios of the threads' breaking load and elongation to those in use."""
    of, table = printed()["specimen"], printed()["elastic_braid"]
    burst = printed()["tested_fams"]
    state = in_situ()
    radius, angle = table["D_in"][0] / 2, float(state.braid_angle[0])
    used = {
        "at the blocked force at 100 psi": (printed()["tested"]["blocked_force_lbf"][-1], 100.0),
        "at the printed burst pressure, with the diameter and angle at 100 psi": (
            burst["burst_force_lbf"], burst["burst_pressure_psi"]
        ),
        "at the printed tensile failure, with the diameter and angle at rest": (
            burst["tensile_failure_lbf"], 0.0
        ),
    }  # fmt: skip
    found = []
    for where, (force, pressure) in used.items():
        at_rest = pressure == 0
        R = table["D_in"][-1] / 2 if at_rest else radius
        theta = float(state.braid_angle[-1]) if at_rest else angle
        tension = float(thread_tension(force, pressure, R, theta, of["threads"]))
        margin = of["thread_break_lbf"] / tension
        found.append(Row("5, thread", f"strength margin of the threads {where}", margin, "1"))
    strain = of["thread_elongation_at_break"] / float(state.strain.max())
    entry = "elongation at break divided by the largest strain in table 5.1"
    return [*found, Row("5, thread", entry, strain, "1")]
