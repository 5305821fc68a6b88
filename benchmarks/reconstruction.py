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
agreement with those tables shows that such isobars exist, and is no test of anything.

The branches lie a half-difference to either side of the mean,

    h(c, P) = (h0 + h1 P) tanh(c / d_h) tanh((c_free - c) / d_h),

which closes the loop at both ends. h0, h1 and d_h are ASSUMED: no hysteresis is printed. Readings
carry independent normal noise in the force, of an ASSUMED standard deviation. The pressure is the
nominal one.
"""

import csv
import dataclasses
import functools
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from famjax import Muscle, units
from famjax.geometries import AbstractGeometry
from famjax.materials import PressurePolynomialMaterial
from fitting import ForceData, Specimen
from fitting.plausible import any_units

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

HYSTERESIS_LBF, HYSTERESIS_LBF_PER_PSI, HYSTERESIS_CONTRACTION = 2.0, 0.1, 0.01
"""h0, h1 and d_h of the half-difference: assumed."""

NOISE_LBF = 2.0
"""Standard deviation of the force: assumed."""

POINTS_PER_BRANCH = 85
"""About 170 points per pressure: one photograph a second at 0.04 in/s over the stroke and back."""


@dataclasses.dataclass(frozen=True)
class SyntheticIsobars:
    """SYNTHETIC readings in SI: at each pressure shortening first, then lengthening.

    Attributes:
        pressure: gauge pressure P [Pa], shape (n,).
        length: active length L [m], shape (n,).
        force: F [N] with hysteresis and noise, shape (n,).
        mean_force: [N] without either, shape (n,): what the construction holds to be true.
        lengthening: True on the eccentric branch, shape (n,).
        rest_length: L0 [m].
        seed: of the noise.
        name: says that it is synthetic; put it wherever these numbers go.
    """

    pressure: Float[np.ndarray, " n"]
    length: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    mean_force: Float[np.ndarray, " n"]
    lengthening: Bool[np.ndarray, " n"]
    rest_length: float
    seed: int
    name: str = NAME

    def branch_means(self) -> tuple[Float[np.ndarray, " m"], ...]:
        """Pressure [Pa], length [m] and mean force of both branches [N], shape (n / 2,) each."""
        shape = -1, 2, POINTS_PER_BRANCH
        there, back = np.moveaxis(self.force.reshape(shape), 1, 0)
        pressure, length = (a.reshape(shape)[:, 0].ravel() for a in (self.pressure, self.length))
        return pressure, length, ((there + back[:, ::-1]) / 2).ravel()


def reconstruct(seed: int = 0, *, noise_lbf: float = NOISE_LBF) -> SyntheticIsobars:
    """The SYNTHETIC isobars at 10 to 100 psi; see the module for how they are made.

    Args:
        seed: of the noise; the same seed gives the same readings.
        noise_lbf: standard deviation of the force [lbf]; 0 for none.

    Returns:
        170 readings per pressure, in SI.
    """
    pressure, blocked, free = tested_ends()
    share = np.linspace(0, 1, POINTS_PER_BRANCH)
    c = free[:, None] * np.concatenate([share, share[::-1]])
    P = np.broadcast_to(pressure[:, None], c.shape)
    mean = _mean_force(c, pressure[:, None], blocked[:, None])
    half = HYSTERESIS_LBF + HYSTERESIS_LBF_PER_PSI * P
    half = half * np.tanh(c / HYSTERESIS_CONTRACTION)
    half = half * np.tanh((c.max(axis=1, keepdims=True) - c) / HYSTERESIS_CONTRACTION)
    lengthening = np.broadcast_to(np.arange(c.shape[1]) >= POINTS_PER_BRANCH, c.shape)
    noise = noise_lbf * np.random.default_rng(seed).standard_normal(c.shape)
    force = mean + np.where(lengthening, half, -half) + noise
    rest = printed()["specimen"]["active_length_in"] * units.INCH
    return SyntheticIsobars(
        pressure=P.ravel() * units.PSI,
        length=rest * (1 - c.ravel()),
        force=force.ravel() * units.LBF,
        mean_force=mean.ravel() * units.LBF,
        lengthening=lengthening.ravel(),
        rest_length=rest,
        seed=seed,
    )


def write_csv(path: Path, isobars: SyntheticIsobars) -> Path:
    """The SYNTHETIC readings as a file that `fitting.read_csv` reads, marked as such.

    Args:
        path: the file.
        isobars: from `reconstruct`.

    Returns:
        The path.
    """
    of = printed()["specimen"]
    head = (
        f"# {isobars.name}: nothing here is measured; seed {isobars.seed}",
        f"# specimen: name = {isobars.name}",
        f"# specimen: rest_length_in = {of['active_length_in']}",
        f"# specimen: nominal_diameter_in = {of['nominal_diameter_in']}",
        f"# specimen: wall_thickness_in = {of['bladder_thickness_in']}",
        f"# specimen: bladder_diameter_in = {of['bladder_outer_diameter_in']}",
        f"# specimen: braid_thickness_in = {of['braid_thickness_in']}",
    )
    columns = (
        isobars.pressure / units.PSI,
        isobars.length / units.INCH,
        isobars.force / units.LBF,
    )
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write("\n".join(head) + "\n")
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("pressure_psi", "length_in", "force_lbf"))
        rows.writerows(tuple(f"{v:.7g}" for v in row) for row in zip(*columns, strict=True))
    return path


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


@any_units()
def force_map(n_pressures: int = 10, thin: int = 1) -> ForceData:
    """The mean of the branches of the SYNTHETIC isobars in inch, psi and lbf.

    Args:
        n_pressures: how many of the ten isobars.
        thin: every `thin`-th reading of them.
    """
    isobars, of = reconstruct(), printed()["specimen"]
    P, length, force = isobars.branch_means()
    P = P / units.PSI
    levels = np.unique(P)[:: -(-10 // n_pressures)]
    keep = np.isin(P, levels) & (np.arange(P.size) % thin == 0)
    specimen = Specimen(
        name=NAME,
        rest_length=of["active_length_in"],
        wall_thickness=of["bladder_thickness_in"],
        nominal_diameter=of["nominal_diameter_in"],
        bladder_diameter=of["bladder_outer_diameter_in"],
        braid_thickness=of["braid_thickness_in"],
    )
    return ForceData(
        force=force[keep] / units.LBF,
        pressure=P[keep],
        length=length[keep] / units.INCH,
        specimen=specimen,
        source="SYNTHETIC",
    )
