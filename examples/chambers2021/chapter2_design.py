"""Chapter 2, design: which braids fit which bladders, and the end-fitting that clamps both."""

import fractions
import itertools
import math

import jax.numpy as jnp
import numpy as np
from beside_print import Chapter, Row, beside, printed
from jaxtyping import Array, Float

from famjax import units
from famjax.braids import NEUTRAL_ANGLE, gaylord_force
from famjax.compile_options import quick_jit
from famjax.design import (
    fam_angle,
    fitting_diameter_on_bladder,
    fitting_diameter_on_braid,
    load_catalogue,
    swaged_bore,
)

chapter = Chapter(__name__)


# %% [markdown]
# # Chapter 2: design
# Each muscle consists of a latex tube, a braided Kevlar sleeve and two end-fittings with swaged metal
# tubes. The chapter determines the force and contraction of a braid on a bladder, which braids fit which
# bladders, and the diameter of the inner fitting at which the swage holds. Every table in this script is
# computed from the printed dimensions; measured results are used as inputs.
#
# ## Table 2.1: earlier muscles, and the ideal forces of their braids
# The table lists Gaylord's force P pi R^2 (2 tan^2 theta - 1) at rest, and the contraction at which theta
# reaches the neutral angle of 35.26 deg. Every muscle that was built contracts less than its braid would
# by itself, because the bladder resists. Two of these muscles pull harder than a braid with the same
# nominal diameter and angle would.


# %%
@chapter.table("table 2.1: muscles, and their braids by themselves")
def swaged() -> list[Row]:
    """Return table 2.1 for ideal braids, and their differences from the muscles that were built."""
    found = []
    for of in printed()["swaged_fam"]:
        name, pressure, theta = of["name"], of["pressure_psi"], math.radians(of["braid_angle_deg"])
        diameter = float(fractions.Fraction(name.split()[0]))
        force = float(gaylord_force(pressure, diameter / 2, theta))
        contraction = 1 - math.sin(NEUTRAL_ANGLE) / math.sin(theta)
        for what, computed, tested, unit in (
            ("blocked force", force, of["max_force_lbf"], "lbf"),
            ("free contraction", contraction, of["contraction"], "1"),
        ):
            entry = f"{name}, {what} of the braid by itself"
            shown = f"{tested} lbf" if unit == "lbf" else f"{tested}"
            found += [
                Row("2.1", entry, computed, unit),
                Row("2.1", f"{entry} minus the tested {shown}", computed - tested, unit),
            ]
    return found


# %% [markdown]
# ## Table 2.2: angles at which braids jam
# The nominal diameter of a braid is its diameter at a braid angle of 45 deg. At another diameter, the
# same thread has a different angle. The braid jams when its yarns touch.

# %%
_angle_rad = quick_jit(fam_angle)


def _angle(diameter: float, nominal: float) -> float:
    """Return the braid angle [deg] at a diameter."""
    return math.degrees(_angle_rad(np.array(diameter), np.array(nominal)))


@chapter.table("table 2.2: angles at which braids jam")
def jamming_angles() -> list[Row]:
    found = []
    for k, braid in enumerate(printed()["kevlar_braid"]):
        nominal = braid["nominal_diameter_in"]
        for end, diameter in enumerate(braid["diameter_range_in"]):
            entry = f"{nominal} in braid, angle at {diameter} in"
            key = f"kevlar_braid.{k}.angle_range_deg.{end}"
            found.append(beside("2.2", entry, _angle(diameter, nominal), "deg", key))
    return found


# %% [markdown]
# ## Table 2.3: braids on bladders
# The table lists the angle of each braid on each bladder. In the reference work, a cell is empty if the
# braid jams before it fits the bladder.


# %%
@chapter.table("table 2.3: angles of braids on bladders")
def braid_angles() -> list[Row]:
    table = printed()["braid_angle_table"]
    columns = {1.5: "braid_1p5", 2.0: "braid_2p0", 2.5: "braid_2p5"}
    offered = {
        round(braid.nominal_diameter / units.INCH, 6): braid for braid in load_catalogue().braids
    }
    found = []
    for (nominal, column), (k, diameter) in itertools.product(
        columns.items(), enumerate(table["fam_diameter_in"])
    ):
        computed = _angle(diameter, nominal)
        low, high = np.array(offered[nominal].diameter_range) / units.INCH
        outside = " (boundary)" if table[column][k] else " (infeasible)"
        remark = "" if low <= diameter <= high else outside
        entry = f"{nominal} in braid on a {diameter} in bladder{remark}"
        if table[column][k]:
            key = f"braid_angle_table.{column}.{k}"
            found.append(beside("2.3", entry, computed, "deg", key))
        else:
            found.append(Row("2.3", entry, computed, "deg"))
    return found


# %% [markdown]
# ## Table 2.4: the inner fitting
# The swaged tube presses the braid and bladder onto the inner fitting. The diameter of the fitting follows
# from the bore after swaging and the required compression. An error of a thousandth of an inch matters.


# %%
@quick_jit
def _fittings() -> tuple[Float[Array, ""], ...]:
    """Return the fitting diameters [in] under braid and bladder, and the change in compression [-]."""
    of, specimen = printed()["end_fitting"], printed()["specimen"]
    braid, wall = specimen["braid_thickness_in"], specimen["bladder_thickness_in"]
    tube = of["swage_tube_od_in"]
    bore = swaged_bore(tube, of["swage_tube_thickness_in"], of["swage_reduction"])
    on_braid = fitting_diameter_on_braid(bore, braid, of["braid_compression"])
    on_bladder = fitting_diameter_on_bladder(bore, braid, wall, of["bladder_compression"])
    return on_braid, on_bladder, 0.001 / jnp.asarray(braid)


@chapter.table("table 2.4: inner fittings")
def end_fitting() -> list[Row]:
    on_braid, on_bladder, per_thousandth = map(float, _fittings())
    die, why = 0.0005, "half a unit in the last digit of the die's reduction, 0.027 in"
    return [
        beside("2.4", "inner fitting under the braid", on_braid, "in",
               "end_fitting.internal_fitting_od_braid_in", die, why),
        beside("2.4", "inner fitting under the bladder", on_bladder, "in",
               "end_fitting.internal_fitting_od_bladder_in", die, why),
        beside("2.4", "change in braid compression for 0.001 in on the radius of the fitting",
               per_thousandth, "1", "end_fitting.compression_change_per_thousandth_in"),
    ]  # fmt: skip


# %% [markdown]
# ## The support of the swage tube
# The die pushes on a tube 3.10 in long, which may buckle. A support is inserted 1.25 in into the tube and
# "approximately doubles" Euler's buckling load, according to the reference work. If the support is rigid,
# only a column of 1.85 in can buckle. If the support only stiffens a column that is pinned at both ends,
# the load rises little. Between these extremes, a finite lateral stiffness at the support's inner end
# doubles the load.


# %%
def stepped_column_gain(inserted: float, stiffening: float) -> float:
    """Return the ratio of Euler's load for a pinned column, stiffened at one end, to that of a plain one.

    The gain follows from the smallest root of alpha cot(alpha a) + beta cot(beta b) = 0, where
    b = `inserted`, a = 1 - b, alpha = pi sqrt(gain) and beta = alpha / sqrt(stiffening).

    Args:
        inserted: fraction of the column's length that the support stiffens [-], in (0, 1).
        stiffening: ratio of the second moments of area, stiffened to plain [-], >= 1.

    Returns:
        Gain in Euler's load [-], from 1 to `stiffening`.

    References:
        Timoshenko & Gere 1961, Theory of Elastic Stability, article 2.14.

    >>> print(f"{stepped_column_gain(1.25 / 3.10, 1.756):.2f}")  # the reference work's tube
    1.14
    """
    low, high = 1.0, stiffening  # the restraint falls from low to high
    while low < (middle := (low + high) / 2) < high:
        low, high = (
            (middle, high) if _restraint(middle, inserted, stiffening) > 0 else (low, middle)
        )
    return high


def support_stiffness(gain: float, inserted: float, stiffening: float) -> float:
    """Return the lateral stiffness at the support's inner end that multiplies Euler's load by a gain.

    The column is that of `stepped_column_gain`, held at the end of the support by a spring k:

        k = P g / (a b g - 1),  g = alpha cot(alpha a) + beta cot(beta b)

    in units of the plain column's length and load, where P is the gain.

    Args:
        gain: ratio of the load to that of the plain column [-], above `stepped_column_gain` and below the
            ratio for the weaker part by itself, pinned at both ends, 1 / a^2 or `stiffening` / b^2.
        inserted: fraction of the column's length that the support stiffens [-], in (0, 1).
        stiffening: ratio of the second moments of area, stiffened to plain [-], >= 1.

    Returns:
        k L / P_Euler [-], where P_Euler and L are the load and length of the plain column.

    Raises:
        ValueError: no spring produces this gain.

    >>> print(f"{support_stiffness(2.0, 1.25 / 3.10, 1.756):.2f}")
    5.37
    """
    g = _restraint(gain, inserted, stiffening)
    most = min(1 / (1 - inserted) ** 2, stiffening / inserted**2)
    if not (g < 0 and 1 < gain < most):
        least = stepped_column_gain(inserted, stiffening)
        raise ValueError(
            f"the gain with an elastic lateral support must be between {least:.4g} and {most:.4g}, "
            f"but is {gain:.4g}"
        )
    return gain * g / ((1 - inserted) * inserted * g - 1)


def _restraint(gain: float, inserted: float, stiffening: float) -> float:
    """Return the sum g in `support_stiffness`; negative if the joint buckles without a spring."""
    alpha = math.pi * math.sqrt(gain)
    beta = alpha / math.sqrt(stiffening)
    return alpha / math.tan(alpha * (1 - inserted)) + beta / math.tan(beta * inserted)


@chapter.table("section 2.4: support of the swage tube")
def tube_support() -> list[Row]:
    of = printed()["end_fitting"]
    length, inserted = of["swage_tube_length_in"], of["support_inserted_in"]
    outer, bore = of["swage_tube_od_in"], of["swage_tube_od_in"] - 2 * of["swage_tube_thickness_in"]
    support = outer - 2 * of["tube_support_wall_in"]
    stiffer = 1 + (bore**4 - support**4) / (outer**4 - bore**4)
    rigid = (length / (length - inserted)) ** 2
    stepped = float(stepped_column_gain(inserted / length, stiffer))
    doubling = float(support_stiffness(2.0, inserted / length, stiffer))
    return [
        beside("2.4, support", "unsupported length with the support inserted", length - inserted, "in",
               "end_fitting.unsupported_length_after_support_in"),
        Row("2.4, support", "second moment of area with the support, relative to the tube's", stiffer, "1"),
        Row("2.4, support", "gain in Euler's load with a rigid support", rigid, "1"),
        Row("2.4, support", "gain in Euler's load for a stepped column pinned at both ends", stepped, "1"),
        Row("2.4, support", "lateral stiffness at the support's inner end that doubles the load, "
            "multiplied by the length and divided by the bare tube's load", doubling, "1"),
    ]  # fmt: skip


# %% [markdown]
# ## Table 2.5: safety factors of the tested muscles


# %%
@chapter.table("table 2.5: safety factors")
def safety() -> list[Row]:
    of = printed()["tested_fams"]
    force = max(of["blocked_force_100psi_lbf"])
    burst = of["burst_pressure_psi"] / 100.0
    pull = of["tensile_failure_lbf"] / force
    torn = of["burst_force_lbf"] / force
    return [
        Row("2.5", "burst force divided by the largest blocked force at 100 psi", torn, "1"),
        Row("2.5", "burst pressure divided by 100 psi", burst, "1"),
        Row("2.5", "failure load divided by the largest blocked force at 100 psi", pull, "1"),
    ]
