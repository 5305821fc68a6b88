"""SYNTHETIC reconstruction of the tested isobars, which the reference work does not print.

Nothing here is measured. The mean force at contraction c and gauge pressure P is that of the
measured geometry with a law that is linear in pressure, and what the work's fits left at both ends:

    F(c, P) = F_model(c, E(P)) + A0(P) exp(-c / d) + A1(P) exp((c - c_free) / d)
    E_n(P) = E_n + s_n (P - 55 psi) / (45 psi)

E_n is the work's optimum of table 7.3. s is what brings the model's free contraction to that of the
work's best fit (tables 6.12 and 7.6), along the one direction in E_n to which it responds most: more
cannot be told from five numbers. A0 and A1 close the gap to the tested blocked force and free
contraction (tables 6.11 and 6.12, at 20, 40, 60, 80 and 100 psi); blocked forces and the model's
errors of free contraction are linear in pressure between those, and go on so to 10 psi. The steep
start is no invention: the work's fits miss the blocked force by 16 lbf while they leave 2 to 3 lbf
in all (table 7.2). How steep, d, is ASSUMED.

The branches lie a half-difference to either side of the mean,

    h(c, P) = (h0 + h1 P) tanh(c / d_h) tanh((c_free - c) / d_h),

which closes the loop at both ends, so that blocked force and free contraction are met by either.
h0, h1 and d_h are ASSUMED: no hysteresis is printed. Readings carry independent normal noise in the
force. Its standard deviation is ASSUMED too: with it, and with d, the fits of the branches' mean
leave what the work's left, 2.7 lbf RMSE and 2.0 lbf MAE of the most flexible one (chapter 7,
"Hocking", where the print has the two the other way round: no RMSE is below its MAE). The pressure is
the nominal one.
"""

import csv
import dataclasses
import functools
from pathlib import Path

import chambers_examples  # noqa: F401 -- where the specimen is found
import jax.numpy as jnp
import numpy as np
from beside_print import printed
from force_balance import balance, free_contraction
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from specimen import ENDS, geometries

from famjax import Muscle, units
from famjax.materials import PressurePolynomialMaterial

NAME = "SYNTHETIC reconstruction of the 7/8 in FAM of Chambers 2021"
HYSTERESIS_LBF, HYSTERESIS_LBF_PER_PSI, HYSTERESIS_CONTRACTION = 2.0, 0.1, 0.01
"""h0, h1 and d_h of the half-difference: assumed."""

END_CONTRACTION = 0.01
"""d, over which what the fits miss at either end fades: assumed."""

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
    isobars = _isobars()
    share = np.linspace(0, 1, POINTS_PER_BRANCH)
    c = isobars.free_contraction[:, None] * np.concatenate([share, share[::-1]])
    P = np.broadcast_to(isobars.pressure[:, None], c.shape)
    mean = isobars.mean_force(c)
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


@dataclasses.dataclass(frozen=True)
class _Isobars:
    """The mean curves, in psi and lbf; shape (pressures,) each."""

    pressure: Float[np.ndarray, " p"]
    muscle: Muscle
    blocked_force: Float[np.ndarray, " p"]
    free_contraction: Float[np.ndarray, " p"]

    def mean_force(self, contraction: Float[np.ndarray, "p k"]) -> Float[np.ndarray, "p k"]:
        """F(c, P) [lbf] of the module's equation."""
        force, d = self._model(contraction), END_CONTRACTION
        free = self.free_contraction[:, None]
        rest = self.blocked_force[:, None] - self._model(np.zeros_like(free))
        last = -self._model(free)
        # Neither end's remainder may reach the other end, however little is left of it there.
        reach = np.exp(-free / d)
        at_rest = (rest - last * reach) / (1 - reach**2)
        at_free = (last - rest * reach) / (1 - reach**2)
        return (
            force + at_rest * np.exp(-contraction / d) + at_free * np.exp((contraction - free) / d)
        )

    def _model(self, contraction: Float[np.ndarray, "p k"]) -> Float[np.ndarray, "p k"]:
        return _force(self.muscle, contraction, self.pressure[:, None])


@functools.cache
def _isobars() -> _Isobars:
    """Laws and ends at all tested pressures."""
    tested, pressures = printed()["tested"], printed()["specimen"]["pressures_tested_psi"]
    P, known = np.array(pressures, float), np.array(tested["pressure_psi"], float)
    best = printed()["best_fit"]
    missed = dict(zip(best["pressure_psi"], best["free_contraction_error"], strict=True))
    measured_free = np.array(tested["free_contraction"])
    model_free = measured_free + np.array([missed[p] for p in tested["pressure_psi"]])
    E = np.array(printed()["fixed_third_order"]["E_optimised_psi"])
    change = _change(E, model_free, known)
    muscle = _muscle(E, change)
    own_free = free_contraction(muscle, P)
    at = np.array([pressures.index(p) for p in tested["pressure_psi"]])
    return _Isobars(
        P,
        muscle,
        _linear(P, known, np.array(tested["blocked_force_lbf"], float)),
        own_free + _linear(P, known, measured_free - own_free[at]),
    )


def _share(pressure: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    return (pressure - 55) / 45


def _change(
    E: Float[np.ndarray, " n"], free: Float[np.ndarray, " p"], pressure: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " n"]:
    """s_n [psi]: forces at the free contractions to zero, along the direction that does most.

    Coefficients count by the stress they make at the largest hoop strain, 1.65 (table 6.2).
    """
    size = 1.65 ** np.arange(1, E.size + 1)
    force = _force(_muscle(E), free, pressure)
    columns = np.stack(
        [_force(_muscle(E + one), free, pressure) - force for one in np.eye(E.size)], axis=1
    )
    u, value, v = np.linalg.svd(columns * _share(pressure)[:, None] / size, full_matrices=False)
    return -(u[:, 0] @ force) / value[0] * v[0] / size


def _linear(
    x: Float[np.ndarray, " n"], nodes: Float[np.ndarray, " k"], values: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " n"]:
    """Linear between the nodes, which increase; below the first the first line goes on."""
    slope = (values[1] - values[0]) / (nodes[1] - nodes[0])
    return np.interp(x, nodes, values) + np.minimum(x - nodes[0], 0) * slope


def _muscle(E: Float[np.ndarray, " n"], change: ArrayLike = 0.0) -> Muscle:
    """The measured geometry with the law E_n(P) = E_n + s_n (P - 55 psi) / (45 psi)."""
    nodes = np.array(ENDS)
    coefficients = E + _share(nodes)[:, None] * change
    law = PressurePolynomialMaterial(jnp.asarray(nodes), jnp.asarray(coefficients))
    return Muscle(geometries()["measured"], law)


def _force(
    muscle: Muscle, contraction: Float[np.ndarray, "..."], pressure: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "..."]:
    """Force [lbf], broadcast shape."""
    return balance(muscle, contraction, pressure)["total force"]
