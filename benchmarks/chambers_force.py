"""Chapter 6: strains, thickness, stresses and forces of the four geometries."""

import dataclasses
import functools
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from chambers_reference import PRESSURES, Row, muscles, printed
from jaxtyping import Array, Float

from famjax import Muscle, bladder_axial_force, bladder_hoop_force, gaylord_force, tube_volume

MOMENTS = 0.015
"""Relative tolerance of strain moments."""

THICKNESS = 0.0002
"""Tolerance [in] of the bladder's thickness."""

GAYLORD = 0.002
"""Tolerance of Gaylord's force, relative to the published force at rest."""

HEADLINE = {"in": 0.01, "deg": 0.1, "1": 0.005}
"""Tolerance of the differences in the summary: one unit of their last digit; 0.5 % of diameter."""

PRINTED_FREE = 0.353
"""Contraction of tables 6.1 and 6.2."""

GRID = 101
"""Points from rest to a free contraction, over which extremes and means are taken."""

OWN, TESTED = slice(0, GRID), slice(GRID, 2 * GRID)
"""Columns of `Terms` from rest to the geometry's own and to the tested free contraction."""

PRINTED, LAST = 2 * GRID, 2 * GRID + 1
"""Columns of `Terms` at `PRINTED_FREE` and at the last profile measured."""

ORDERS = 4


@dataclasses.dataclass(frozen=True)
class Terms:
    """Everything in the balance, over pressure (rows) and contraction (columns); psi, in, lbf."""

    contraction: Float[np.ndarray, "pressures columns"]
    values: dict[str, Float[np.ndarray, "pressures columns"]]

    def at(self, quantity: str, row: int, state: str) -> float:
        """The quantity at one pressure and state; at an extreme of its size, with its sign."""
        values = self.values[quantity][row]
        size = np.abs(values[OWN])
        column = {
            "rest": 0,
            "free": OWN.stop - 1,
            "tested free": TESTED.stop - 1,
            "maximum": int(size.argmax()),
            "minimum": int(size.argmin()),
        }[state]
        return float(values[column])

    def at_100_psi(self, quantity: str) -> Float[np.ndarray, " columns"]:
        """The quantity at all contractions of the highest pressure."""
        return self.values[quantity][-1]


QUANTITIES = {
    "bladder thickness": ("6.4", "in"),
    "longitudinal stress": ("6.5", "psi"),
    "circumferential stress": ("6.6", "psi"),
    "longitudinal bladder force": ("6.7", "lbf"),
    "circumferential bladder force": ("6.8", "lbf"),
    "bladder force": ("6.9", "lbf"),
    "Gaylord force": ("6.3", "lbf"),
    "total force": ("6, total force", "lbf"),
}
"""Table and unit of each quantity over contraction. Tables 6.4 to 6.9 are assigned by subject."""

STATES = {
    "rest": "at rest",
    "free": "at its own free contraction",
    "tested free": "at the tested free contraction",
    "maximum": "at the maximum",
}


@eqx.filter_jit
def balance(
    muscle: Muscle, contraction: Float[Array, "..."], pressure: Float[Array, "..."]
) -> dict[str, Float[Array, "..."]]:
    """The terms of the force balance, strains and their moments included, broadcast shape."""
    length = muscle.geometry.rest_length * (1 - contraction)
    at = muscle.geometry.dimensions(length, pressure)
    axial, hoop = muscle.material.stresses(
        at.axial_strain[..., None], at.hoop_strain, pressure[..., None]
    )
    axial, hoop = (jnp.sum(at.station_weights * stress, axis=-1) for stress in (axial, hoop))
    axial_force = bladder_axial_force(axial, at.bladder_volume, at.length)
    hoop_force = bladder_hoop_force(hoop, at.thickness, at.length, at.radius, at.turns)
    gaylord = gaylord_force(pressure, at.radius, at.braid_angle)
    moments = {
        f"{name} strain {n}": jnp.sum(at.station_weights * strain**n, axis=-1)
        for name, strain in (("axial", jnp.abs(at.axial_strain[..., None])), ("hoop", at.hoop_strain))
        for n in range(1, ORDERS + 1)
    }
    return {
        "diameter": 2 * at.radius,
        "braid angle": jnp.rad2deg(at.braid_angle),
        "bladder thickness": at.thickness,
        "longitudinal stress": axial,
        "circumferential stress": hoop,
        "longitudinal bladder force": axial_force,
        "circumferential bladder force": hoop_force,
        "bladder force": axial_force + hoop_force,
        "Gaylord force": gaylord,
        "total force": gaylord + axial_force + hoop_force,
        **moments,
    }


@eqx.filter_jit
def _free_contraction(muscle: Muscle, pressure: Float[Array, " n"]) -> Float[Array, " n"]:
    return muscle.free_contraction(pressure)


@functools.cache
def free_contractions() -> dict[str, Float[np.ndarray, " pressures"]]:
    """Free contraction of each geometry at `PRESSURES`: where its own model's force is zero."""
    pressures = jnp.array(PRESSURES)
    return {name: np.asarray(_free_contraction(m, pressures)) for name, m in muscles().items()}


@functools.cache
def terms() -> dict[str, Terms]:
    """The terms of each geometry."""
    tested = np.array(printed()["tested"]["free_contraction"])[:, None]
    last = printed()["profile_100psi"][-1]["contraction"]
    share = np.linspace(0, 1, GRID)
    places = np.broadcast_to([PRINTED_FREE, last], (len(PRESSURES), 2))
    found = {}
    for name, muscle in muscles().items():
        own = free_contractions()[name][:, None]
        contraction = np.hstack([own * share, tested * share, places])
        pressures = np.broadcast_to(np.array(PRESSURES)[:, None], contraction.shape)
        values = balance(muscle, jnp.asarray(contraction), jnp.asarray(pressures))
        found[name] = Terms(contraction, {key: np.asarray(v) for key, v in values.items()})
    return found


def rows() -> list[Row]:
    """The latex specimen, tables 6.1 to 6.9, 6.11 and 6.12, and the summary's differences."""
    return [
        *_latex(),
        *_strains(),
        *_thinnest(),
        *_gaylord(),
        *_over_contraction(),
        *_headline(),
        *_blocked(),
        *_free(),
    ]


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
                for n, published in enumerate(printed()[key][kind], 1):
                    computed = float(terms()[geometry].at_100_psi(f"{strain} strain {n}")[column])
                    entry = f"{label}, mean of |{strain} strain|^{n}, {place}"
                    found.append(Row(table, entry, computed, "1", published, MOMENTS * published))
    return found


def _thinnest() -> list[Row]:
    published, found = printed()["bladder_thickness"], []
    for name, of in terms().items():
        least = float(of.at_100_psi("bladder thickness")[TESTED].min())
        entry = f"{name}, least bladder thickness of the 100 psi test"
        known = published.get(name.replace(" ", "_"))
        found.append(Row("6.4", entry, least, "in", known, known and THICKNESS))
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
            entries["mean absolute difference of Gaylord force from the measured average diameter"] = (
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
        (float(terms()[name].at_100_psi(quantity)[PRINTED]) for quantity in ("diameter", "braid angle"))
        for name in ("estimated elastic", "measured")
    )
    length = specimen["active_length_in"] * (1 - PRINTED_FREE)
    thread, measured_thread = (
        math.hypot(length, math.pi * specimen["turns_N"] * diameter) for diameter in (D, D_measured)
    )
    found = (
        ("diameter, estimated minus measured", D - D_measured, "in", "diameter_overestimate_in"),
        ("braid angle, measured minus estimated", theta_measured - theta, "deg", "braid_angle_underestimate_deg"),
        ("thread length lost to curvature", thread - measured_thread, "in", "thread_length_lost_to_curvature_in"),
    )
    return [
        *(Row(table, entry, value, unit, of[key], HEADLINE[unit]) for entry, value, unit, key in found),
        Row(table, "the diameter's difference over the measured", D / D_measured - 1, "1", 0.047, HEADLINE["1"]),
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
    return found
