"""Chapter 6: strains, thickness, stresses and forces of the four geometries."""

import math

import numpy as np
from chambers_balance import LAST, PRINTED, PRINTED_FREE, TESTED, free_contractions, terms
from chambers_reference import PRESSURES, Row, Table, printed

from famjax.geometries import tube_volume

MOMENTS = 0.015
"""Relative tolerance of strain moments, to which half a unit of the last printed digit is added."""

THICKNESS = 0.0002
"""Tolerance [in] of the bladder's thickness."""

GAYLORD = 0.002
"""Tolerance of Gaylord's force, relative to the published force at rest."""

HEADLINE = {"in": 0.01, "deg": 0.1, "1": 0.005}
"""Tolerance of the differences in the summary: one unit of their last digit; 0.5 % of diameter."""

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

STRAINS = {
    f"{strain} strain {n}": (table, "1")
    for table, strain in (("6.1", "axial"), ("6.2", "hoop"))
    for n in range(1, 5)
}
"""The same of the powers of strain."""

STATES = {
    "rest": "at rest",
    "free": "at its own free contraction",
    "tested free": "at the tested free contraction",
    "maximum": "at the maximum",
}


def _latex() -> list[Row]:
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


def _strains() -> list[Row]:
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


def _decimals(row: list[float]) -> int:
    """Decimals to which a row is printed: the most that one of its figures shows."""
    return max(len(str(value).partition(".")[2]) for value in row)


def _thinnest() -> list[Row]:
    published, found = printed()["bladder_thickness"], []
    for name, of in terms().items():
        least = float(of.at_100_psi("bladder thickness")[TESTED].min())
        entry = f"{name}, least bladder thickness of the 100 psi test"
        known = published.get(name.replace(" ", "_"))
        found.append(Row("6, thickness", entry, least, "in", known, known and THICKNESS))
    return found


def _gaylord() -> list[Row]:
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


def _over_contraction() -> list[Row]:
    """Each quantity, geometry, pressure and state of which no figure was given to us."""
    found = []
    for quantity, (table, unit) in QUANTITIES.items():
        for name, of in terms().items():
            for row, P in enumerate(PRESSURES):
                for state, text in _states(quantity, name, P).items():
                    entry = f"{name}, {P:g} psi, {quantity} {text}"
                    found.append(Row(table, entry, of.at(quantity, row, state), unit))
    return found


def _mean_absolute() -> list[Row]:
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


def _states(quantity: str, geometry: str, pressure: float) -> dict[str, str]:
    """The states that `_over_contraction` lists; what has a published figure is in `_gaylord`."""
    if quantity == "bladder thickness":
        return STATES | {"minimum": "at the minimum"}
    if quantity == "Gaylord force" and pressure == 100 and geometry != "measured":
        return {state: STATES[state] for state in ("free", "maximum")}
    return STATES


def _headline() -> list[Row]:
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


def _blocked() -> list[Row]:
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


def _free() -> list[Row]:
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


TABLES: tuple[Table, ...] = (
    ("section 6: latex specimen", _latex),
    ("tables 6.1 and 6.2: strains", _strains),
    ("section 6: least thickness", _thinnest),
    ("table 6.3: Gaylord's force", _gaylord),
    ("tables 6.3 to 6.9: terms of the balance", _over_contraction),
    ("tables 6.1 to 6.9: mean absolute differences", _mean_absolute),
    ("section 6: summary", _headline),
    ("table 6.11: blocked force", _blocked),
    ("table 6.12: free contraction", _free),
)
"""In the order of the work."""
