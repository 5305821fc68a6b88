"""Friction from hysteresis: terms fitted to the half-differences of loops."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError
from famjax.terms import AbstractFriction, PressureFriction, ThreadFriction

from .cyclic_record import ISOBAR
from .loop import HysteresisLoop


@dataclasses.dataclass(frozen=True)
class FrictionFit:
    """A friction term fitted to the half-differences of loops.

    Attributes:
        friction: the term, for use beside a `famjax.Muscle`.
        names, values, stderr: of its parameters, in SI. The errors hold for independent points of
            the grid; where the form of the term is wrong they are too small.
        mae, rmse: mean absolute and root mean square error [N] of the half-difference.
        n_points: number of points fitted.
    """

    friction: AbstractFriction
    names: tuple[str, ...]
    values: Float[np.ndarray, " p"]
    stderr: Float[np.ndarray, " p"]
    mae: float
    rmse: float
    n_points: int


def fit_pressure_friction(loops: Sequence[HysteresisLoop], *, trim: float = 0.05) -> FrictionFit:
    """The friction c0 + c1 P that fits the half-differences of loops at several pressures best.

    Args:
        loops: at least two, at different pressures.
        trim: part of each loop's range that is left out at either end, where the motion turns
            round and friction has not fully built up.

    Returns:
        The fit, its term a `famjax.terms.PressureFriction`.

    Raises:
        InputError: fewer than two pressures.
    """
    levels = [float(loop.pressure.mean()) for loop in loops]
    if len(loops) < 2 or np.ptp(levels) <= ISOBAR * np.abs(levels).max():
        raise InputError(
            "a constant and a slope in pressure need loops at two pressures at least, more than "
            f"{ISOBAR:.0%} apart; got loops at {', '.join(f'{P:.6g} Pa' for P in levels)}"
        )
    pressure, target = _inner(loops, trim, "pressure", "half_difference")
    design = np.stack([np.ones_like(pressure), pressure], axis=1)
    return _fitted(PressureFriction, ("constant", "per_pressure"), design, target)


def fit_thread_friction(
    loops: Sequence[HysteresisLoop],
    geometry: famjax.geometries.AbstractGeometry,
    *,
    rest_area: float | None = None,
    trim: float = 0.05,
) -> FrictionFit:
    """The coefficient of thread friction f_s S P that fits the half-differences of loops best.

    Args:
        loops: at least one, with pressure.
        geometry: of the muscle; it gives the braid angle along the loops.
        rest_area: contact area S0 [m2] at rest; None for the lateral surface 2 pi R0 L0.
        trim: part of each loop's range that is left out at either end, where the motion turns
            round and friction has not fully built up.

    Returns:
        The fit, its term a `famjax.terms.ThreadFriction`.

    Raises:
        InputError: no loops, a `rest_area` that is not > 0, or loops at lengths that the geometry
            cannot take.
    """
    if not loops:
        raise InputError("thread friction needs at least one loop, got none")
    rest = geometry.dimensions(geometry.rest_length, 0.0)
    area = float(2 * np.pi * rest.radius * rest.length) if rest_area is None else rest_area
    if not (np.isfinite(area) and area > 0):
        raise InputError(f"rest_area must be > 0 and finite, got {area} m2")
    length, pressure, target = _inner(loops, trim, "length", "pressure", "half_difference")
    unit = ThreadFriction(1.0, area, rest.braid_angle)
    column = np.asarray(unit.amplitude(geometry.dimensions(length, pressure), pressure), float)
    if not np.isfinite(column).all() or not column.any():
        raise InputError(
            f"the geometry has no braid angle somewhere between {length.min():.6g} and "
            f"{length.max():.6g} m, or the loops have no pressure: check lengths and units"
        )

    def of(coefficient: float) -> ThreadFriction:
        return ThreadFriction(coefficient, area, rest.braid_angle)

    return _fitted(of, ("coefficient",), column[:, None], target)


def _inner(
    loops: Sequence[HysteresisLoop], trim: float, *names: str
) -> list[Float[np.ndarray, " all"]]:
    """Quantities at the points of all loops, one after another, without the trimmed ends."""
    if not 0 <= trim < 0.5:
        raise InputError(f"trim is a fraction of the range in [0, 0.5), got {trim}")
    sizes = [loop.contraction.size for loop in loops]
    kept = [slice(cut := round(trim * size), size - cut) for size in sizes]
    return [
        np.concatenate([getattr(one, name)[rows] for one, rows in zip(loops, kept, strict=True)])
        for name in names
    ]


def _fitted(
    friction: Callable[..., AbstractFriction],
    names: tuple[str, ...],
    design: Float[np.ndarray, "k p"],
    target: Float[np.ndarray, " k"],
) -> FrictionFit:
    """The friction of the values that fit best: it is linear in them."""
    scale = np.abs(design).max(axis=0)
    inverse = np.linalg.pinv(design / scale) / scale[:, None]
    values = inverse @ target
    residual = design @ values - target
    freedom = target.size - values.size
    variance = residual @ residual / freedom if freedom > 0 else np.nan
    return FrictionFit(
        friction=friction(*values),
        names=names,
        values=values,
        stderr=np.sqrt(variance * np.sum(inverse**2, axis=1)),
        mae=float(np.mean(np.abs(residual))),
        rmse=float(np.sqrt(np.mean(residual**2))),
        n_points=residual.size,
    )
