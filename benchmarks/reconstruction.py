"""SYNTHETIC reconstruction of the tested isobars, which the reference work does not print.

Nothing here is measured. The mean force at contraction c and gauge pressure P is the measured
geometry's with the latex of chapter 6, stretched so that it meets what was tested:

    F(c, P) = s(P) F_model(k(P) c, P),  s = F_tested / F_model at c = 0,  k = c_model / c_tested

with blocked force and free contraction from tables 6.11 and 6.12 at 20, 40, 60, 80 and 100 psi.
Both ratios are linear in 1 / P between those pressures, and go on so to 10 psi. The branches lie a
half-difference to either side,

    h(c, P) = (h0 + h1 P) tanh(c / d) tanh((c_free - c) / d),

which closes the loop at both ends, so that blocked force and free contraction are met by either.
h0, h1 and d are ASSUMED: no hysteresis is printed. Readings carry independent normal noise in the
force. Its standard deviation is ASSUMED too, half of the 2.0 lbf RMSE that the work's most flexible
fit left (chapter 7, "Hocking"), which no noise may exceed. The pressure is the nominal one.
"""

import csv
import dataclasses
import functools
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from chambers_balance import balance, free_contraction
from chambers_reference import muscles, printed
from jaxtyping import Bool, Float

from famjax import units

NAME = "SYNTHETIC reconstruction of the 7/8 in FAM of Chambers 2021"
HYSTERESIS_LBF, HYSTERESIS_LBF_PER_PSI, HYSTERESIS_CONTRACTION = 2.0, 0.1, 0.01
"""h0, h1 and d of the half-difference: assumed."""

NOISE_LBF = 1.0
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


def reconstruct(seed: int = 0, *, noise_lbf: float = NOISE_LBF) -> SyntheticIsobars:
    """The SYNTHETIC isobars at 10 to 100 psi; see the module for how they are made.

    Args:
        seed: of the noise; the same seed gives the same readings.
        noise_lbf: standard deviation of the force [lbf]; 0 for none.

    Returns:
        170 readings per pressure, in SI.
    """
    pressures, blocked_ratio, contraction_ratio, model_free = _ratios()
    share = np.linspace(0, 1, POINTS_PER_BRANCH)
    c = (model_free / contraction_ratio)[:, None] * np.concatenate([share, share[::-1]])
    P = np.broadcast_to(pressures[:, None], c.shape)
    mean = blocked_ratio[:, None] * _model_force(contraction_ratio[:, None] * c, P)
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


@functools.cache
def _ratios() -> tuple[Float[np.ndarray, " p"], ...]:
    """Pressures [psi], s and k at each, and the model's free contraction."""
    tested, pressures = printed()["tested"], printed()["specimen"]["pressures_tested_psi"]
    P = np.array(pressures, float)
    model_free = np.asarray(free_contraction(muscles()["measured"], jnp.asarray(P)))
    model_blocked = _model_force(np.zeros_like(P), P)
    at = np.array([pressures.index(p) for p in tested["pressure_psi"]])
    blocked_ratio = np.array(tested["blocked_force_lbf"]) / model_blocked[at]
    contraction_ratio = model_free[at] / np.array(tested["free_contraction"])
    s, k = (_linear(1 / P, 1 / P[at], ratio) for ratio in (blocked_ratio, contraction_ratio))
    return P, s, k, model_free


def _linear(
    x: Float[np.ndarray, " n"], nodes: Float[np.ndarray, " k"], values: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " n"]:
    """Linear between the nodes, which decrease; beyond the first the first line goes on."""
    slope = (values[0] - values[1]) / (nodes[0] - nodes[1])
    inside = np.interp(x, nodes[::-1], values[::-1])
    return inside + np.maximum(x - nodes[0], 0) * slope


def _model_force(
    contraction: Float[np.ndarray, "..."], pressure: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "..."]:
    """Force [lbf] of the measured geometry with the latex of chapter 6."""
    terms = balance(muscles()["measured"], jnp.asarray(contraction), jnp.asarray(pressure))
    return np.asarray(terms["total force"])
