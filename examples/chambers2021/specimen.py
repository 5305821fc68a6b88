"""Models of the dissertation's 7/8 in muscle: braid, bladder, shape and latex.

Values are in inches and psi, as printed. The arguments `inch` and `psi` convert them to other units.
"""

import functools
import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from beside_print import printed
from jaxtyping import Array

from famjax import Bladder, Braid, ElasticBraid, EstimatedGeometry, MeasuredGeometry, Muscle, Real
from famjax.braids import LinearThread
from famjax.compile_options import quick_jit
from famjax.geometries import AbstractGeometry
from famjax.materials import PressurePolynomialMaterial
from famjax.measured import AverageDiameterGeometry
from famjax.profiles import FourierProfile
from famjax.surfaces import MeasuredFamily

PRESSURES = (20.0, 40.0, 60.0, 80.0, 100.0)
"""Gauge pressures [psi] in the printed force tables."""

ENDS = (10.0, 100.0)
"""Lowest and highest tested gauge pressures [psi], the nodes of a law that is linear in pressure."""


def bladder(inch: float = 1.0) -> Bladder:
    """Return the latex tube of the 7/8 in specimen."""
    of = printed()["specimen"]
    return Bladder(
        of["active_length_in"] * inch,
        of["bladder_outer_diameter_in"] * inch,
        of["bladder_thickness_in"] * inch,
    )


class Change(NamedTuple):
    """Changes to the specimen within the uncertainty of the printed values, in inches and turns.

    Attributes:
        thread_length: change in B0.
        turns: change in N.
        diameter: change in the diameter of every photographed profile.
    """

    thread_length: Real = 0.0
    turns: Real = 0.0
    diameter: Real = 0.0


NONE = Change()


def inelastic_braid(inch: float = 1.0, change: Change = NONE) -> Braid:
    """Return the specimen's braid, with inextensible threads of the length used in chapter 6."""
    of = printed()["specimen"]
    return Braid(
        (of["thread_length_B_used_in_chapter_6_in"] + change.thread_length) * inch,
        of["turns_N"] + change.turns,
        of["braid_thickness_in"] * inch,
    )


def elastic_braid(
    softness: Real = 1.0, *, inch: float = 1.0, psi: float = 1.0, change: Change = NONE
) -> ElasticBraid:
    """Return the specimen's braid with the in-situ thread modulus, 11.6e6 psi, divided by `softness`."""
    of, braid = printed()["specimen"], inelastic_braid(inch, change)
    modulus = of["thread_modulus_in_situ_linear_psi"] * psi / softness
    thread = LinearThread(modulus, of["thread_area_in2"] * inch**2)
    return ElasticBraid(
        braid.rest_thread_length, braid.turns, braid.thickness, of["threads"], thread
    )


def transcribed_profile(row: dict[str, Any]) -> FourierProfile:
    """Return one row of table 4.3 with its misprints corrected, but not made symmetric."""
    return FourierProfile(row["a"][0], row["a"][1:], row["b"], row["w_corrected"])


def profile(row: dict[str, Any]) -> FourierProfile:
    """Return one row of table 4.3 as it is used: symmetric about the middle of the profile.

    The printed a_n and b_n determine w. The odd part of the profile about x = 1/2,

    o_n = b_n cos(n w / 2) - a_n sin(n w / 2),

    is minimised in the least-squares sense, and the remainder is removed. In every row the remainder is
    within the rounding of the printed values: 0.005 in each coefficient, and 0.05 in b_3 = -0.5 at 35 %.
    That row requires w to four decimals, 2.1776. With the transcribed 2.176, the error in a_1 would be
    seven times its rounding.
    """
    a, b = np.array(row["a"][1:]), np.array(row["b"])
    n, w = np.arange(1, a.size + 1), row["w_corrected"]
    for _ in range(20):  # Gauss-Newton
        half = n * w / 2
        odd = b * np.cos(half) - a * np.sin(half)
        rate = -n / 2 * (b * np.sin(half) + a * np.cos(half))
        w -= rate @ odd / (rate @ rate)
    return FourierProfile(row["a"][0], a, b, w).symmetrised()


def measured_family(inch: float = 1.0, psi: float = 1.0, change: Change = NONE) -> MeasuredFamily:
    """Return the profiles in table 4.3, corrected, symmetric, and scaled with pressure by the braid."""
    rest = printed()["specimen"]["active_length_in"] * inch
    rows = printed()["profile_100psi"]
    return MeasuredFamily(
        lengths=jnp.array([rest * (1 - row["contraction"]) for row in rows]),
        profiles=tuple(_scaled(profile(row), inch, change.diameter) for row in rows),
        reference_pressure=100.0 * psi,
        braid=elastic_braid(inch=inch, psi=psi, change=change),
    )


def _scaled(one: FourierProfile, inch: float, wider: Real) -> FourierProfile:
    return FourierProfile((one.a0 + wider) * inch, one.a * inch, one.b * inch, one.w)


def tube_volume(length: float, outer_diameter: float, thickness: float) -> float:
    """Return the volume of material in a tube, V = pi t (D - t) L."""
    return math.pi * thickness * (outer_diameter - thickness) * length


def elliptic_ends(
    x: Real, length: Real, middle: Real, end: Real, end_length: float, angle: float
) -> Array:
    """Return the diameter of a cylinder whose ends are elliptic arcs swept around the axis.

    Each arc leaves the cylinder tangentially and covers `angle` [rad] of the ellipse's parameter.

    Args:
        x: position as a fraction of the active length.
        length: active length.
        middle: diameter of the cylinder.
        end: diameter at the fittings.
        end_length: axial length of each end.
        angle: in (0, pi/2).
    """
    zeta = jnp.minimum(jnp.minimum(x, 1 - x) * length / end_length, 1)
    height = jnp.sqrt(math.cos(angle) ** 2 + math.sin(angle) ** 2 * zeta * (2 - zeta))
    rise = (height - math.cos(angle)) / (1 - math.cos(angle))
    return jnp.asarray(end + (middle - end) * rise)


def latex() -> PressurePolynomialMaterial:
    """Return the latex law from chapter 6 in psi, the same at all pressures.

    It is expressed as a law that is linear in pressure, so that it shares compiled programs with such laws.
    """
    E = printed()["latex"]["E_psi"]
    return PressurePolynomialMaterial(jnp.array(ENDS), jnp.array([E, E]))


GEOMETRIES = ("estimated inelastic", "estimated elastic", "measured average diameter", "measured")
"""Names of the four geometries, in the order of `four_geometries`."""


def four_geometries(
    inch: float = 1.0, psi: float = 1.0, change: Change = NONE
) -> tuple[AbstractGeometry, ...]:
    """Build the four geometries of the specimen, in the order of `GEOMETRIES`."""
    family, tube = measured_family(inch, psi, change), bladder(inch)
    return (
        EstimatedGeometry(inelastic_braid(inch, change), tube),
        EstimatedGeometry(elastic_braid(inch=inch, psi=psi, change=change), tube),
        AverageDiameterGeometry(family, tube),
        MeasuredGeometry(family, tube),
    )


@quick_jit
def _build(change: Change) -> tuple[tuple[AbstractGeometry, ...], PressurePolynomialMaterial]:
    """Build the geometries and the latex law in one program instead of one per operation."""
    return four_geometries(change=change), latex()


@functools.cache
def muscles(change: Change = NONE) -> dict[str, Muscle]:
    """Return the four muscles of the specimen, with the latex law, by name."""
    shapes, law = _build(Change(*map(np.asarray, map(float, change))))
    return {name: Muscle(shape, law) for name, shape in zip(GEOMETRIES, shapes, strict=True)}


def geometries() -> dict[str, AbstractGeometry]:
    """Return the four geometries of the specimen, by name."""
    return {name: muscle.geometry for name, muscle in muscles().items()}


def open_turns() -> float:
    """Return the uncertainty of N = 1.09, from pi N D = B cos(theta) and the rounding in table 5.1."""
    table, used = printed()["elastic_braid"], printed()["specimen"]["turns_N"]
    D, B, theta = np.array(table["D_in"]), np.array(table["B_in"]), np.deg2rad(table["theta_deg"])
    N = B * np.cos(theta) / (np.pi * D)
    half = N * (0.0005 / D + 0.0005 / B + np.deg2rad(0.005) * np.tan(theta))
    return float(max(used - (N - half).max(), (N + half).min() - used))
