"""Fit photographs and force readings together, with a muscle shape computed from mechanics.

The photographs enter the fit as Gaussian priors. Their residuals are linearised about the current
parameters and reduced by a QR decomposition to one row per parameter. This is repeated until the
parameters converge (Gauss-Newton), so the optimum and the covariance account for all forces and
diameters together.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from famjax.boundary.errors import InputError

from .convex import AnyArray
from .problem import Prior, Problem
from .response import MuscleFamily
from .search import End, descend
from .shapes import Pictures

POSITIONS = (np.arange(12) + 0.5) / 12
"""Positions z/L at which diameters are compared: evenly spaced, excluding the ends."""
_MOST = 16  # pictures in a fit; a stroke has no more detail, and each costs an equilibrium per step
_POINTS = 201  # of a computed profile: linear interpolation is then below a photograph's error
_ROUNDS = 30  # at most
_WEIGHED = 5  # rounds after which the weights stay constant, so that the iteration can converge
_SETTLED = 1e-6  # largest change of a parameter, relative to its bounds
_KEYS = {
    "names": "names", "length": "length_m", "pressure": "pressure_Pa", "position": "position",
    "measured": "measured_diameter_m", "computed": "computed_diameter_m", "stderr": "diameter_stderr_m",
}  # fmt: skip
"""Key in `fit.json` for each field."""


@dataclasses.dataclass(frozen=True)
class PictureFit:
    """Photographed and computed profiles from a joint fit.

    Attributes:
        names: file names of the n pictures.
        length, pressure: active length L [m] and gauge pressure P [Pa], shape (n,).
        position: positions z/L [-], shape (m,).
        measured, computed: braid diameter D [m], shape (n, m).
        stderr: standard error [m] of a diameter: the larger of the stated error and the RMSE.
        priors: the photographs, expressed as priors on the parameters.
    """

    names: tuple[str, ...]
    length: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    position: Float[np.ndarray, " m"]
    measured: Float[np.ndarray, "n m"]
    computed: Float[np.ndarray, "n m"]
    stderr: float
    priors: tuple[Prior, ...] = ()

    @property
    def rmse(self) -> float:
        """RMSE of the computed diameters [m]."""
        return float(np.sqrt(np.mean((self.computed - self.measured) ** 2)))

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-ready data in SI units."""
        found = {key: np.asarray(getattr(self, name)).tolist() for name, key in _KEYS.items()}
        return {**found, "priors": [[p.direction.tolist(), p.mean, p.std] for p in self.priors]}

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> "PictureFit":
        """Rebuild a joint fit from the result of `as_dict`."""
        found = {name: np.array(saved[key]) for name, key in _KEYS.items()}
        priors = tuple(Prior(np.array(row), mean, std) for row, mean, std in saved["priors"])
        said = {"names": tuple(saved["names"]), "stderr": float(saved[_KEYS["stderr"]])}
        return cls(**{**found, **said, "priors": priors})

    def summary(self) -> str:
        """Summarise the joint fit in one sentence."""
        return (
            f"Profile and force were fitted together: the diameters in {len(self.names)} photographs "
            f"differ from the computed ones by {self.rmse * 1e3:.2g} mm RMS "
            f"({self.rmse / self.measured.mean():.2%} of the mean diameter)."
        )


def read_pictures(table: Any) -> Pictures:
    """Read the photographs for a joint fit, and keep at most 16 spread over the whole stroke.

    Args:
        table: path to a `measurements.nc`; every picture needs a pressure.

    Raises:
        InputError: the table cannot be read, or a picture has no pressure.
    """
    pictures = Pictures.of(table)
    if not np.isfinite(pictures.pressure).all():
        raise InputError(
            f"{pictures.source}: every photograph needs a pressure, because the shape depends on it. Run "
            "famjax measure --log with a log that contains the pressure, or famjax characterise"
        )
    wanted = np.linspace(pictures.length.min(), pictures.length.max(), _MOST)
    nearest = np.abs(pictures.length - wanted[:, None]).argmin(axis=1)
    return pictures.part(np.unique(nearest) if len(pictures) > _MOST else np.arange(len(pictures)))


def join(
    problem: Problem, best: End, pictures: Pictures, noise: float | None
) -> tuple[End, Problem, PictureFit]:
    """Fit the force and the photographs together, starting from the best fit to the force alone.

    Each picture counts as one force reading, because its diameters share a common error. Force
    residuals are divided by `noise`, or by their RMSE if `noise` is None. Diameter residuals are
    divided by the larger of the stated diameter error and their RMSE.

    Args:
        problem: problem with one force map and a shape computed from mechanics.
        best: optimum of the problem without the photographs.
        pictures: photographs from `read_pictures`.
        noise: standard deviation of a weighted force reading; None if not stated.

    Returns:
        (optimum, problem with the photographs as priors, photographed and computed profiles).

    Raises:
        InputError: the muscle has no stable shape in a photographed state, or the joint fit does not
            converge.
    """
    (part,) = problem.parts
    grid = np.linspace(0, 1, pictures.diameter.shape[1])
    measured = np.stack([np.interp(POSITIONS, grid, one) for one in pictures.diameter])
    local = pictures.mean_std if pictures.local_std is None else np.median(pictures.local_std)
    stated = float(np.hypot(local, pictures.scale_std * measured.mean()))
    own, weights = problem.priors, (problem.noise, stated)
    for done in range(_ROUNDS):
        p = best.point.parameters
        at = part.family, p[part.at], pictures.length, pictures.pressure
        computed, slope = map(np.asarray, _diameters_and_slopes(*at))
        lost = ~np.isfinite(computed).all(axis=1) | ~np.isfinite(slope).all(axis=(1, 2))
        if lost.any():
            raise InputError(
                "the muscle that fits the force readings has no stable shape at the length and pressure of "
                f"{int(lost.sum())} photographs, for example {pictures.names[int(np.argmax(lost))]}: check "
                "that the lengths and pressures in the force map and the photographs are consistent"
            )
        off = computed - measured
        if done < _WEIGHED:
            force = best.point.residual[: problem.force.size]
            weights = (
                noise or float(np.sqrt(np.mean(force**2))),
                max(stated, float(np.sqrt(np.mean(off**2)))),
            )
        rows = np.zeros((off.size, len(problem.names)))
        rows[:, part.at] = slope.reshape(off.size, -1)
        scale = 1 / (weights[1] * np.sqrt(POSITIONS.size))
        found = _compressed(scale * rows, scale * (rows @ p - off.ravel()))
        problem = dataclasses.replace(problem, noise=weights[0], priors=(*own, *found))
        last, best = best.u, descend(problem, best.u)
        if done >= _WEIGHED and np.abs(best.u - last).max() < _SETTLED:
            fit = PictureFit(
                pictures.names, pictures.length, pictures.pressure, POSITIONS, measured, computed,
                weights[1], found,
            )  # fmt: skip
            return best, problem, fit
    raise InputError(
        f"the joint fit to force and photographs did not converge in {_ROUNDS} iterations: set bounds or "
        "priors on the parameters that the data do not determine"
    )


def _compressed(rows: np.ndarray, targets: np.ndarray) -> tuple[Prior, ...]:
    """Reduce weighted rows to priors with the same normal equations; zero rows are dropped."""
    size = np.linalg.norm(rows, axis=0)
    Q, R = np.linalg.qr(rows / np.where(size > 0, size, 1.0))
    R, t = R * size, Q.T @ targets
    length = np.linalg.norm(R, axis=1)
    return tuple(
        Prior(R[k] / length[k], t[k] / length[k], 1 / length[k]) for k in np.flatnonzero(length > 0)
    )


@eqx.filter_jit
def _diameters_and_slopes(
    family: MuscleFamily, p: AnyArray, length: AnyArray, pressure: AnyArray
) -> tuple[Float[Array, "n m"], Float[Array, "n m q"]]:
    """Return braid diameters [m] at `POSITIONS`, and their derivatives with respect to the parameters."""

    def diameters(p: Array) -> tuple[Array, Array]:
        muscle = family.build(dict(zip(family.nonlinear, p, strict=True)))
        shape = muscle.profile(length, pressure, _POINTS)
        found = jax.vmap(lambda L, z, r: jnp.interp(POSITIONS * L, z, 2 * r))(
            length, shape.position, shape.radius
        )
        return found, found

    slope, found = jax.jacfwd(diameters, has_aux=True)(jnp.asarray(p))
    return found, slope
