"""SYNTHETIC reconstruction of the tested isobars, which the reference work does not print.

Nothing here is measured. The mean force at contraction c and gauge pressure P is that of the
measured geometry with a fourth-order law that is linear in pressure, and two terms that fade from
either end:

    F(c, P) = F_model(c, E(P)) + A0(P) exp(-c / d0) + A1(P) exp((c - c_free) / d1)

A0 and A1 close the gap to the tested blocked force and free contraction. Those are printed at 20,
40, 60, 80 and 100 psi (tables 6.11 and 6.12); at 10 psi they follow from the errors of table 7.6,
which it prints in lbf and in percent; between, they are linear in pressure. The eight coefficients
of E and the two widths, `LAW` and `WIDTHS`, are a least-squares solution of the inverse problem: the
work's fits, repeated on these isobars, are to leave the errors that tables 7.1 to 7.6 print. So the
agreement with those tables shows that such isobars exist, and is no test of anything. Readings are
means of two branches, of which each carries independent normal noise of an ASSUMED standard deviation.
"""

import functools
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from famjax import Muscle
from famjax.geometries import AbstractGeometry
from famjax.materials import PressurePolynomialMaterial
from fitting import ForceData, Specimen
from fitting.specimen import any_units

CHAPTERS = Path(__file__).resolve().parents[1] / "examples" / "chambers2021"
if str(CHAPTERS) not in sys.path:
    sys.path.insert(0, str(CHAPTERS))

from beside_print import printed  # noqa: E402 -- found by the line above
from force_balance import balance  # noqa: E402
from specimen import ENDS, geometries  # noqa: E402

NAME = "SYNTHETIC reconstruction of the 7/8 in FAM of Chambers 2021"
LAW = ((319.9, -231.8, 119.9, -16.5), (-26.5, 1073.8, -668.2, 122.1))
"""E_1 to E_4 [psi] at 10 and at 100 psi."""
WIDTHS = (0.0089, 0.0727)
"""d0 and d1, contractions."""
NOISE_LBF = 2.0
"""Standard deviation of the force on a branch: assumed."""
POINTS_PER_BRANCH = 85
"""About 170 points per pressure: one photograph a second at 0.04 in/s over the stroke and back."""


@any_units()
def force_map(*, noise_lbf: float = NOISE_LBF) -> ForceData:
    """The SYNTHETIC isobars at 10 to 100 psi, in inch, psi and lbf; see the head of this file.

    Args:
        noise_lbf: standard deviation of the force on either branch [lbf]; 0 for none.

    Returns:
        85 readings at each of ten pressures.
    """
    pressure, blocked, free = tested_ends()
    c = free[:, None] * np.linspace(0, 1, POINTS_PER_BRANCH)
    mean = _mean_force(c, pressure[:, None], blocked[:, None])
    noise = np.random.default_rng(0).standard_normal((pressure.size, 2, POINTS_PER_BRANCH))
    force = mean + noise_lbf * (noise[:, 0] + noise[:, 1, ::-1]) / 2
    of = printed()["specimen"]
    specimen = Specimen(
        name=NAME,
        rest_length=of["active_length_in"],
        wall_thickness=of["bladder_thickness_in"],
        nominal_diameter=of["nominal_diameter_in"],
        bladder_diameter=of["bladder_outer_diameter_in"],
        braid_thickness=of["braid_thickness_in"],
    )
    return ForceData(
        force=force.ravel(),
        pressure=np.repeat(pressure, POINTS_PER_BRANCH),
        length=of["active_length_in"] * (1 - c.ravel()),
        specimen=specimen,
        source="SYNTHETIC",
    )


def tested_ends() -> tuple[Float[np.ndarray, " pressures"], ...]:
    """Gauge pressure [psi], blocked force [lbf] and free contraction [-] of the ten isobars."""
    tested, best = printed()["tested"], printed()["best_fit"]
    lowest = best["pressure_psi"].index(10)
    at_10 = (
        100 * best[f"{error}"][lowest] / best[f"{percent}"][lowest]
        for error, percent in (
            ("blocked_error_lbf", "blocked_error_percent"),
            ("free_contraction_error", "free_contraction_error_percent"),
        )
    )
    pressure = np.array(printed()["specimen"]["pressures_tested_psi"], float)
    blocked, free = (
        np.interp(pressure, [10, *tested["pressure_psi"]], [first, *tested[key]])
        for first, key in zip(at_10, ("blocked_force_lbf", "free_contraction"), strict=True)
    )
    return pressure, blocked, free


@functools.cache
def _muscle() -> Muscle:
    law = PressurePolynomialMaterial(jnp.asarray(ENDS), jnp.asarray(LAW))
    return Muscle(measured_geometry(), law)


def _mean_force(
    contraction: Float[np.ndarray, "p k"],
    pressure: Float[np.ndarray, "p 1"],
    blocked: Float[np.ndarray, "p 1"],
) -> Float[np.ndarray, "p k"]:
    """F(c, P) [lbf] of the module's equation; the largest contraction of a row is the free one."""
    free = contraction.max(axis=1, keepdims=True)
    force, rest, last = (
        balance(_muscle(), c, pressure)["total force"] for c in (contraction, 0 * free, free)
    )
    d0, d1 = WIDTHS
    # Either term has something left at the other end.
    reach0, reach1 = np.exp(-free / d0), np.exp(-free / d1)
    gap, whole = blocked - rest, 1 - reach0 * reach1
    at_rest, at_free = (gap + last * reach1) / whole, (-last - gap * reach0) / whole
    return force + at_rest * np.exp(-contraction / d0) + at_free * np.exp((contraction - free) / d1)


def measured_geometry() -> AbstractGeometry:
    """The specimen's measured geometry, in inch and psi."""
    return geometries()["measured"]
