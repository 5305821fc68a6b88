"""Chapter 2, design: which braid on which bladder, and the fitting that holds both."""

import fractions
import itertools
import math

import jax.numpy as jnp
import numpy as np
from beside_print import Chapter, Row, printed
from jaxtyping import Array, Float

from famjax import units
from famjax.braids import NEUTRAL_ANGLE, gaylord_force
from famjax.compile_options import quick_jit
from famjax.design import (
    CatalogueBraid,
    Combination,
    Feasibility,
    compression_sensitivity,
    fam_angle,
    feasibility,
    fitting_diameter_on_bladder,
    fitting_diameter_on_braid,
    load_catalogue,
    safety_factor,
    swaged_bore,
)

chapter = Chapter(__name__)


# %% [markdown]
# # Chapter 2: design
# The muscles are made of a latex tube, a braided Kevlar sleeve and two end-fittings over which a
# metal tube is swaged. The chapter asks what force and contraction a braid on a bladder gives, which
# braids go on which bladders at all, and how wide the inner fitting must be for the swage to hold.
# Nothing is measured here that famjax could compute: each table follows from sizes in the print.
#
# ## Table 2.1: what muscles built before do, and what their braids alone would
# Gaylord's force P pi R^2 (2 tan^2 theta - 1) at rest, and the contraction at which theta has fallen to
# the neutral angle of 35.26 deg. Every built muscle contracts less: its bladder takes a share. Two pull
# more than the braid of their name and angle would.


# %%
@chapter.table("table 2.1: muscles and their braids alone")
def swaged() -> list[Row]:
    """Table 2.1: what the ideal braid alone would do, and how far the built muscles are from it."""
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
            entry = f"{name}, {what} of the braid alone"
            shown = f"{tested} lbf" if unit == "lbf" else f"{tested}"
            found += [
                Row("2.1", entry, computed, unit),
                Row("2.1", f"{entry} minus the tested {shown}", computed - tested, unit),
            ]
    return found


# %% [markdown]
# ## Table 2.2: angles at which braids jam
# A braid is named by its diameter at 45 deg. The same thread at another diameter lies at another
# angle, and where yarns touch, the braid can go no further.

# %%
ANGLE = 0.05
"""Tolerance [deg]: half the last digit of tables 2.2 and 2.3."""

_angle_rad = quick_jit(fam_angle)


def _angle(diameter: float, nominal: float) -> float:
    """Braid angle [deg]."""
    return math.degrees(_angle_rad(np.array(diameter), np.array(nominal)))


@chapter.table("table 2.2: angles at which braids jam")
def jamming_angles() -> list[Row]:
    found = []
    for braid in printed()["kevlar_braid"]:
        nominal = braid["nominal_diameter_in"]
        for diameter, angle in zip(
            braid["diameter_range_in"], braid["angle_range_deg"], strict=True
        ):
            computed = _angle(diameter, nominal)
            entry = f"{nominal} in braid, angle at {diameter} in"
            found.append(Row("2.2", entry, computed, "deg", angle, ANGLE))
    return found


# %% [markdown]
# ## Table 2.3: braids on bladders
# The angle that each braid takes on each bladder; empty in the print where the braid jams first.


# %%
@chapter.table("table 2.3: angles of braids on bladders")
def braid_angles() -> list[Row]:
    table = printed()["braid_angle_table"]
    columns = {1.5: table["braid_1p5"], 2.0: table["braid_2p0"], 2.5: table["braid_2p5"]}
    offered = {
        round(braid.nominal_diameter / units.INCH, 6): braid for braid in load_catalogue().braids
    }
    found = []
    for (nominal, angles), (k, diameter) in itertools.product(
        columns.items(), enumerate(table["fam_diameter_in"])
    ):
        computed = _angle(diameter, nominal)
        verdict = feasibility(diameter * units.INCH, offered[nominal])
        remark = "" if verdict is Feasibility.FEASIBLE else f" ({verdict})"
        entry = f"{nominal} in braid on {diameter} in{remark}"
        if angles[k]:
            found.append(Row("2.3", entry, computed, "deg", float(angles[k]), ANGLE))
        else:
            found.append(Row("2.3", entry, computed, "deg"))
    return found


def combination(diameter: float, braid: CatalogueBraid) -> Combination:
    """A bladder of that outer diameter [in] and the specimen's wall under a braid, in inch."""
    numbers = (
        diameter,
        printed()["specimen"]["bladder_thickness_in"],
        *(
            size / units.INCH
            for size in (braid.nominal_diameter, braid.thickness, *braid.diameter_range)
        ),
    )
    return Combination(*map(jnp.asarray, numbers), rest_length=jnp.ones(()))


# %% [markdown]
# ## Table 2.4: the inner fitting
# The swaged tube presses braid, and bladder, onto the inner fitting: its diameter follows from the
# bore after swaging and the compression wanted. A thousandth of an inch matters.

# %%
FITTING = 0.001
"""Tolerance [in]: the last digit of table 2.4, whose rule is derived and not copied."""


@quick_jit
def _fittings() -> tuple[Float[Array, ""], ...]:
    """Diameters [in] under braid and bladder, and the change of compression [-]."""
    of, specimen = printed()["end_fitting"], printed()["specimen"]
    braid, wall = specimen["braid_thickness_in"], specimen["bladder_thickness_in"]
    tube = of["swage_tube_od_in"]
    bore = swaged_bore(tube, of["swage_tube_thickness_in"], of["swage_reduction"])
    on_braid = fitting_diameter_on_braid(bore, braid, of["braid_compression"])
    on_bladder = fitting_diameter_on_bladder(bore, braid, wall, of["bladder_compression"])
    return on_braid, on_bladder, 0.001 * compression_sensitivity(bore, on_braid, braid)


@chapter.table("table 2.4: inner fittings")
def end_fitting() -> list[Row]:
    of = printed()["end_fitting"]
    on_braid, on_bladder, per_thousandth = _fittings()
    under_braid, under_bladder = (
        of[f"internal_fitting_od_{layer}_in"] for layer in ("braid", "bladder")
    )
    return [
        Row("2.4", "inner fitting under the braid", float(on_braid), "in", under_braid, FITTING),
        Row(
            "2.4",
            "inner fitting under the bladder",
            float(on_bladder),
            "in",
            under_bladder,
            FITTING,
        ),
        Row(
            "2.4",
            "change of the braid's compression, 0.001 in on the radius of the fitting",
            float(per_thousandth),
            "1",
            of["compression_change_per_thousandth_in"],
            0.005,
        ),
    ]


# %% [markdown]
# ## Table 2.5: how far the tested muscles were from breaking


# %%
@chapter.table("table 2.5: safety factors")
def safety() -> list[Row]:
    of = printed()["tested_fams"]
    force = max(of["blocked_force_100psi_lbf"])
    burst = float(safety_factor(of["burst_pressure_psi"], 100.0))
    pull = float(safety_factor(of["tensile_failure_lbf"], force))
    torn = float(safety_factor(of["burst_force_lbf"], force))
    return [
        Row("2.5", "burst force over the largest blocked force at 100 psi", torn, "1"),
        Row("2.5", "burst pressure over 100 psi", burst, "1"),
        Row("2.5", "tensile failure over the largest blocked force at 100 psi", pull, "1"),
    ]
