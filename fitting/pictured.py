"""The shape from mechanics fitted to photographs and force together.

The photographs enter as Gaussian priors: their residuals, linear about the current muscle, are one row
for each parameter (QR). The rows are renewed until the muscle stays where it is, so that the optimum and
its covariance are those of all readings and diameters together (Gauss-Newton).
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
from .response import AbstractFamily
from .search import End, descend
from .shapes import Pictures

POSITIONS = (np.arange(12) + 0.5) / 12
"""Where diameters are compared, z/L."""
_MOST = 16  # pictures; of more, those nearest to evenly spaced lengths
_POINTS = 201  # of a computed profile
_ROUNDS = 30
_WEIGHED = 5  # rounds after which the weights are kept
_SETTLED = 1e-6  # of the box
_KEYS = {
    "names": "names", "length": "length_m", "pressure": "pressure_Pa", "position": "position",
    "measured": "measured_diameter_m", "computed": "computed_diameter_m", "stderr": "diameter_stderr_m",
}  # fmt: skip
"""Where each field is in `fit.json`."""


@dataclasses.dataclass(frozen=True)
class PictureFit:
    """Photographed profiles beside those of the fitted muscle.

    Attributes:
        names: file names of the pictures, n of them.
        length, pressure: L [m] and P [Pa], shape (n,).
        position: z/L, shape (m,).
        measured, computed: braid diameter D [m], shape (n, m).
        stderr: standard error [m] of a diameter in the fit: the stated one, or the RMSE if that is larger.
        priors: the photographs as priors on the parameters.
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
        """Root mean square of computed less measured diameter [m]."""
        return float(np.sqrt(np.mean((self.computed - self.measured) ** 2)))

    def as_dict(self) -> dict[str, Any]:
        """For JSON, in SI."""
        found = {key: np.asarray(getattr(self, name)).tolist() for name, key in _KEYS.items()}
        return {**found, "priors": [[p.direction.tolist(), p.mean, p.std] for p in self.priors]}

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> "PictureFit":
        """From what `as_dict` returned."""
        found = {name: np.array(saved[key]) for name, key in _KEYS.items()}
        priors = tuple(Prior(np.array(row), mean, std) for row, mean, std in saved["priors"])
        said = {"names": tuple(saved["names"]), "stderr": float(saved[_KEYS["stderr"]])}
        return cls(**{**found, **said, "priors": priors})

    def summary(self) -> str:
        """One sentence for the reader of the fit."""
        return (
            f"Profile and force are fitted together: the diameters in {len(self.names)} photographs "
            f"differ from the computed ones by {self.rmse * 1e3:.2g} mm RMS "
            f"({self.rmse / self.measured.mean():.2%})."
        )


def read_pictures(table: Any) -> Pictures:
    """Photographs for a joint fit: those with a pressure, at most 16 over the whole stroke.

    Raises:
        InputError: the table cannot be read, or has pictures without a pressure.
    """
    pictures = Pictures.of(table)
    if not np.isfinite(pictures.pressure).all():
        raise InputError(
            f"{pictures.source}: every photograph needs its pressure, because the shape depends on it: "
            "measure with --log or --pressure"
        )
    wanted = np.linspace(pictures.length.min(), pictures.length.max(), _MOST)
    nearest = np.abs(pictures.length - wanted[:, None]).argmin(axis=1)
    return pictures.part(np.unique(nearest) if len(pictures) > _MOST else np.arange(len(pictures)))


def join(
    problem: Problem, best: End, pictures: Pictures, noise: float | None
) -> tuple[End, Problem, PictureFit]:
    """The muscle that fits force and photographs best, from the one that fits the force.

    Each picture counts as one force reading, because its diameters err together. The weights follow
    from the standard errors; where none is stated, or the misfit is larger, from the RMSE of each kind.

    Args:
        problem: of one force map, with the shape from mechanics.
        best: its optimum without the photographs.
        pictures: from `read_pictures`.
        noise: standard deviation of a force reading, in the unit of the weighted residual; None if
            not stated.

    Returns:
        (optimum, problem with the photographs as priors, computed and measured profiles).

    Raises:
        InputError: a photographed state that the muscle does not have, or no convergence.
    """
    (part,) = problem.parts
    grid = np.linspace(0, 1, pictures.diameter.shape[1])
    measured = np.stack([np.interp(POSITIONS, grid, one) for one in pictures.diameter])
    stated = (
        pictures.mean_std if pictures.local_std is None else float(np.median(pictures.local_std))
    )
    stated = float(np.hypot(stated, pictures.scale_std * measured.mean()))
    own, weights = problem.priors, (problem.noise, stated)
    for done in range(_ROUNDS):
        p = best.point.parameters
        computed, slope = (
            np.asarray(one)
            for one in _diameters_and_slopes(
                part.family, p[part.at], pictures.length, pictures.pressure
            )
        )
        lost = ~np.isfinite(computed).all(axis=1) | ~np.isfinite(slope).all(axis=(1, 2))
        if lost.any():
            raise InputError(
                f"the muscle that fits the force has no stable shape in {int(lost.sum())} photographs, "
                f"for example {pictures.names[int(np.argmax(lost))]}: check that the lengths and "
                "pressures of force map and photographs agree"
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
        f"the fit of force and photographs did not converge in {_ROUNDS} rounds: state bounds or priors "
        "for the parameters that the data do not determine"
    )


def _compressed(rows: np.ndarray, targets: np.ndarray) -> tuple[Prior, ...]:
    """Priors with the normal equations of weighted rows; directions without information are left out."""
    size = np.linalg.norm(rows, axis=0)
    Q, R = np.linalg.qr(rows / np.where(size > 0, size, 1.0))
    R, t = R * size, Q.T @ targets
    length = np.linalg.norm(R, axis=1)
    return tuple(
        Prior(R[k] / length[k], t[k] / length[k], 1 / length[k]) for k in np.flatnonzero(length > 0)
    )


@eqx.filter_jit
def _diameters_and_slopes(
    family: AbstractFamily, p: AnyArray, length: AnyArray, pressure: AnyArray
) -> tuple[Float[Array, "n m"], Float[Array, "n m q"]]:
    """Braid diameters [m] at `POSITIONS`, and their derivatives in the family's parameters."""

    def diameters(p: Array) -> tuple[Array, Array]:
        muscle = family.build(dict(zip(family.nonlinear, p, strict=True)))
        shape = muscle.profile(length, pressure, _POINTS)
        found = jax.vmap(lambda L, z, r: jnp.interp(POSITIONS * L, z, 2 * r))(
            length, shape.position, shape.radius
        )
        return found, found

    slope, found = jax.jacfwd(diameters, has_aux=True)(jnp.asarray(p))
    return found, slope
