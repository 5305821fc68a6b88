"""Chapter 6, the cylindrical approximation: strains, stresses and forces of four geometries."""

import math

import jax.numpy as jnp
import numpy as np
from beside_print import Chapter, Row, printed
from force_balance import (
    LAST,
    PRINTED,
    PRINTED_FREE,
    TESTED,
    free_contractions,
    terms,
)
from specimen import PRESSURES
from twin import Twin

import famjax
from famjax import units
from famjax.geometries import tube_volume

chapter = Chapter(__name__)


# %% [markdown]
# # Chapter 6: the cylindrical approximation
# The pull is that of the pressurised braid, Gaylord's force, less what the bladder takes along and
# around. Each term needs diameter, angle, strain and wall, and the chapter takes them from four
# geometries: a cylinder in an inelastic or an elastic braid (estimated), the mean of the photographed
# diameters, and the photographed shape itself. The question is what the cylinder costs.
#
# ## The latex of the bladder


# %%
@chapter.table("section 6: latex specimen")
def latex() -> list[Row]:
    """The tensile specimen's volume and sections from its tube; half the print's last digit."""
    of, specimen = printed()["latex"], printed()["specimen"]
    before = of["test_length_in"] - 3 / 32
    tube = (specimen["bladder_outer_diameter_in"], specimen["bladder_thickness_in"])
    section, volume = (float(tube_volume(length, *tube)) for length in (1.0, before))
    stretched = volume / (of["test_length_in"] * (1 + 2.1))
    published = (of["cross_section_rest_in2"], of["volume_in3"], of["cross_section_max_strain_in2"])
    return [
        Row("6, latex", "section at rest", section, "in2", published[0], 0.005),
        Row("6, latex", "volume", volume, "in3", published[1], 0.005),
        Row("6, latex", "section at strain 2.1", stretched, "in2", published[2], 0.005),
    ]


# %% [markdown]
# ## Tables 6.1 and 6.2: powers of strain
# A law sigma = sum E_n eps^n needs the mean of eps^n over the length, which is not the mean to the nth.
# Along the shape the bladder is strained less than (L0 - L)/L0: its arc is longer than its axis.

# %%
MOMENTS = 0.015
"""Relative tolerance of strain moments, to which half a unit of the last printed digit is added."""

STRAINS = {
    f"{strain} strain {n}": (table, "1")
    for table, strain in (("6.1", "axial"), ("6.2", "hoop"))
    for n in range(1, 5)
}
"""The same of the powers of strain."""


def _decimals(row: list[float]) -> int:
    """Decimals to which a row is printed: the most that one of its figures shows."""
    return max(len(str(value).partition(".")[2]) for value in row)


@chapter.table("tables 6.1 and 6.2: strains")
def strains() -> list[Row]:
    """Tables 6.1 and 6.2 at the printed contraction, and at the last profile measured."""
    longitudinal = {
        "measured": ("measured", "measured"),
        "cylindrical": ("cylindrical", "estimated inelastic"),
    }
    circumferential = {
        key: (name, name)
        for key, name in (
            ("measured", "measured"),
            ("measured_average_diameter", "measured average diameter"),
            ("estimated_elastic", "estimated elastic"),
            ("estimated_inelastic", "estimated inelastic"),
        )
    }
    found = []
    for table, strain, kinds, key in (
        ("6.1", "axial", longitudinal, "longitudinal_strain"),
        ("6.2", "hoop", circumferential, "circumferential_strain"),
    ):
        for kind, (label, geometry) in kinds.items():
            places = [(PRINTED, "35.3 %")]
            if geometry.startswith("measured"):
                places.append((LAST, "35.0 %, the last profile measured"))
            for column, place in places:
                half_digit = 0.5 * 10.0 ** -_decimals(printed()[key][kind])
                for n, published in enumerate(printed()[key][kind], 1):
                    computed = float(terms()[geometry].at_100_psi(f"{strain} strain {n}")[column])
                    entry = f"{label}, mean of |{strain} strain|^{n}, {place}"
                    tolerance = MOMENTS * published + half_digit
                    found.append(Row(table, entry, computed, "1", published, tolerance))
    return found


THICKNESS = 0.0002
"""Tolerance [in] of the bladder's thickness."""


@chapter.table("section 6: least thickness")
def thinnest() -> list[Row]:
    published, found = printed()["bladder_thickness"], []
    for name, of in terms().items():
        least = float(of.at_100_psi("bladder thickness")[TESTED].min())
        entry = f"{name}, least bladder thickness of the 100 psi test"
        known = published.get(name.replace(" ", "_"))
        found.append(Row("6, thickness", entry, least, "in", known, known and THICKNESS))
    return found


# %% [markdown]
# ## Table 6.3: Gaylord's force

# %%
GAYLORD = 0.002
"""Tolerance of Gaylord's force, relative to the published force at rest."""


@chapter.table("table 6.3: Gaylord's force")
def gaylord() -> list[Row]:
    """Table 6.3: 100 psi, to the tested free contraction."""
    table, found = printed()["gaylord_100psi"], []
    force = {
        name.replace(" ", "_"): of.at_100_psi("Gaylord force")[TESTED]
        for name, of in terms().items()
    }
    average = force["measured_average_diameter"]
    for key, rest in table["resting"].items():
        label, tolerance = f"{key.replace('_', ' ')}, 100 psi,", GAYLORD * rest
        entries = {
            "Gaylord force at rest": (force[key][0], rest),
            "Gaylord force at the tested free contraction": (force[key][-1], table["free"][key]),
        }
        if key in table["mae"]:
            difference = np.abs(force[key] - average).mean()
            entries[
                "mean absolute difference of Gaylord force from the measured average diameter"
            ] = (
                difference,
                table["mae"][key],
            )
        found += [
            Row("6.3", f"{label} {entry}", float(computed), "lbf", published, tolerance)
            for entry, (computed, published) in entries.items()
        ]
    return found


# %% [markdown]
# ## Tables 6.3 to 6.9: every term at rest, when free, at its largest
# The transcription has no numbers of these tables: the first few of ours are shown.

# %%
QUANTITIES = {
    "bladder thickness": ("6, thickness", "in"),
    "Gaylord force": ("6.3", "lbf"),
    "longitudinal stress": ("6.4", "psi"),
    "longitudinal bladder force": ("6.5", "lbf"),
    "circumferential stress": ("6.6", "psi"),
    "circumferential bladder force": ("6.7", "lbf"),
    "bladder force": ("6.8", "lbf"),
    "total force": ("6.9", "lbf"),
}
"""Table, as the work numbers them, and unit of each quantity over contraction."""

STATES = {
    "rest": "at rest",
    "free": "at its own free contraction",
    "tested free": "at the tested free contraction",
    "maximum": "at the maximum",
}


def _states(quantity: str, geometry: str, pressure: float) -> dict[str, str]:
    """The states that `every_term` lists; what has a published figure is in `_gaylord`."""
    if quantity == "bladder thickness":
        return STATES | {"minimum": "at the minimum"}
    if quantity == "Gaylord force" and pressure == 100 and geometry != "measured":
        return {state: STATES[state] for state in ("free", "maximum")}
    return STATES


@chapter.table("tables 6.3 to 6.9: terms of the balance")
def every_term() -> list[Row]:
    """Each quantity, geometry, pressure and state of which no figure was given to us."""
    found = []
    for quantity, (table, unit) in QUANTITIES.items():
        for name, of in terms().items():
            for row, P in enumerate(PRESSURES):
                for state, text in _states(quantity, name, P).items():
                    entry = f"{name}, {P:g} psi, {quantity} {text}"
                    found.append(Row(table, entry, of.at(quantity, row, state), unit))
    return found


@chapter.table("tables 6.1 to 6.9: mean absolute differences")
def mean_absolute() -> list[Row]:
    """The rows of mean absolute errors: each geometry against the measured one.

    Means over contraction from rest to the tested free contraction. That of Gaylord's force at 100
    psi is in `_gaylord`, against the average diameter, which in this term is the measured one.
    """
    measured, found = terms()["measured"], []
    for quantity, (table, unit) in {**STRAINS, **QUANTITIES}.items():
        for name, of in terms().items():
            if name == "measured":
                continue
            difference = of.values[quantity] - measured.values[quantity]
            for row, P in enumerate(PRESSURES):
                if quantity == "Gaylord force" and P == 100 and name.startswith("estimated"):
                    continue
                error = float(np.abs(difference[row, TESTED]).mean())
                what = f"{quantity}, mean absolute difference from the measured"
                entry = f"{name}, {P:g} psi, {what}, to the tested free contraction"
                found.append(Row(table, entry, error, unit))
    return found


# %% [markdown]
# ## The chapter's summary: what the cylinder costs at 35 %

# %%
HEADLINE = {"in": 0.01, "deg": 0.1, "1": 0.005}
"""Tolerance of the differences in the summary: one unit of their last digit; 0.5 % of diameter."""


@chapter.table("section 6: summary")
def headline() -> list[Row]:
    """Estimated (elastic) against measured at 35.3 %, 100 psi."""
    of, specimen, table = printed()["headline"], printed()["specimen"], "6, summary"
    (D, theta), (D_measured, theta_measured) = (
        [float(terms()[name].at_100_psi(key)[PRINTED]) for key in ("diameter", "braid angle")]
        for name in ("estimated elastic", "measured")
    )
    length = specimen["active_length_in"] * (1 - PRINTED_FREE)
    thread, measured_thread = (
        math.hypot(length, math.pi * specimen["turns_N"] * diameter) for diameter in (D, D_measured)
    )
    wider, steeper, lost = D - D_measured, theta_measured - theta, thread - measured_thread
    inch, degree = HEADLINE["in"], HEADLINE["deg"]
    published = [
        of[f"{key}_{unit}"]
        for key, unit in (
            ("diameter_overestimate", "in"),
            ("braid_angle_underestimate", "deg"),
            ("thread_length_lost_to_curvature", "in"),
        )
    ]
    return [
        Row(table, "diameter, estimated minus measured", wider, "in", published[0], inch),
        Row(table, "the same over the measured", wider / D_measured, "1", 0.047, HEADLINE["1"]),
        Row(table, "braid angle, measured minus estimated", steeper, "deg", published[1], degree),
        Row(table, "thread length lost to curvature", lost, "in", published[2], inch),
    ]


# %% [markdown]
# ## Tables 6.11 and 6.12: blocked force and free contraction
# With the latex law of a tensile test, nothing fitted.


# %%
@chapter.table("table 6.11: blocked force")
def blocked() -> list[Row]:
    """Table 6.11: the model columns, and how far each is from the tested column."""
    found = []
    for name, of in terms().items():
        for row, P in enumerate(PRESSURES):
            force = of.at("total force", row, "rest")
            tested = printed()["tested"]["blocked_force_lbf"][row]
            found.append(Row("6.11", f"{name}, {P:g} psi, blocked force", force, "lbf"))
            entry = f"{name}, {P:g} psi, blocked force minus the tested {tested} lbf"
            found.append(Row("6.11", entry, force - tested, "lbf"))
        rest = of.values["total force"][:, 0]
        error = np.abs(rest - printed()["tested"]["blocked_force_lbf"]).mean()
        entry = f"{name}, mean absolute error of the blocked force over the pressures"
        found.append(Row("6.11", entry, float(error), "lbf"))
    return found


@chapter.table("table 6.12: free contraction")
def free() -> list[Row]:
    """Table 6.12: the model columns, and how far each is from the tested column."""
    found = []
    for name, contractions in free_contractions().items():
        for row, P in enumerate(PRESSURES):
            tested = printed()["tested"]["free_contraction"][row]
            found.append(
                Row("6.12", f"{name}, {P:g} psi, free contraction", float(contractions[row]), "1")
            )
            entry = f"{name}, {P:g} psi, free contraction minus the tested {tested}"
            found.append(Row("6.12", entry, float(contractions[row]) - tested, "1"))
        error = np.abs(contractions - printed()["tested"]["free_contraction"]).mean()
        entry = f"{name}, mean absolute error of the free contraction over the pressures"
        found.append(Row("6.12", entry, float(error), "1"))
    return found


# %% [markdown]
# ## The twin: what each geometry misses of measured forces
# The shape is that of its photographs, the law that of its own rubber, which a tensile test would have
# given; nothing is fitted. As in the print the cylinders are the worse.


# %%
def missed(twin: Twin) -> list[Row]:
    """Blocked force and force over the stroke less the twin's own, by geometry and pressure."""
    law, data = famjax.PolynomialMaterial(jnp.array(twin.muscle.coefficients)), twin.data
    level, found = data.pressures.level, []
    for name, shape in twin.geometries().items():
        muscle = famjax.Muscle(shape, law)
        error = np.asarray(muscle.force(data.length, data.pressure)) - data.force
        for bar, P in zip(twin.test.characterisation.isobars, np.unique(level), strict=True):
            rest = float(muscle.blocked_force(bar.pressure)) - bar.blocked_force
            over = float(np.mean(np.abs(error[level == P])))
            at = f"TWIN, {name}, {bar.set_pressure / units.PSI:.0f} psi"
            found += [
                Row("6.11", f"{at}, blocked force minus the tested", rest / units.LBF, "lbf"),
                Row("6.9", f"{at}, mean absolute error over the stroke", over / units.LBF, "lbf"),
            ]
    return found


# %%
if chapter.shown:
    chapter.show("the twin's forces, by geometry", missed(Twin.of_command_line()))
