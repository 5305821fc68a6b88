"""Friction from hysteresis: terms fitted to the half-differences of loops."""

import dataclasses
from collections.abc import Sequence

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
    inner = [_inner(loop, trim) for loop in loops]
    pressure = _joined([loop.pressure for loop in loops], inner)
    design = np.stack([np.ones_like(pressure), pressure], axis=1)
    target = _joined([loop.half_difference for loop in loops], inner)
    values, stderr, residual = _least_squares(design, target)
    friction = PressureFriction(values[0], values[1])
    return _friction_fit(friction, ("constant", "per_pressure"), values, stderr, residual)


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
    inner = [_inner(loop, trim) for loop in loops]
    length = _joined([loop.length for loop in loops], inner)
    pressure = _joined([loop.pressure for loop in loops], inner)
    unit = ThreadFriction(1.0, area, rest.braid_angle)
    column = np.asarray(unit.amplitude(geometry.dimensions(length, pressure), pressure), float)
    if not np.isfinite(column).all() or not column.any():
        raise InputError(
            f"the geometry has no braid angle somewhere between {length.min():.6g} and "
            f"{length.max():.6g} m, or the loops have no pressure: check lengths and units"
        )
    target = _joined([loop.half_difference for loop in loops], inner)
    values, stderr, residual = _least_squares(column[:, None], target)
    friction = ThreadFriction(values[0], area, rest.braid_angle)
    return _friction_fit(friction, ("coefficient",), values, stderr, residual)


def _inner(loop: HysteresisLoop, trim: float) -> slice:
    """The points of a loop without its trimmed ends."""
    if not 0 <= trim < 0.5:
        raise InputError(f"trim is a fraction of the range in [0, 0.5), got {trim}")
    cut = round(trim * loop.contraction.size)
    return slice(cut, loop.contraction.size - cut)


def _joined(
    columns: Sequence[Float[np.ndarray, "..."]], inner: Sequence[slice]
) -> Float[np.ndarray, " all"]:
    return np.concatenate([column[rows] for column, rows in zip(columns, inner, strict=True)])


def _least_squares(
    design: Float[np.ndarray, "k p"], target: Float[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"], Float[np.ndarray, " k"]]:
    """Values, their standard errors, and the residual."""
    scale = np.abs(design).max(axis=0)
    inverse = np.linalg.pinv(design / scale) / scale[:, None]
    values = inverse @ target
    residual = design @ values - target
    freedom = target.size - values.size
    variance = residual @ residual / freedom if freedom > 0 else np.nan
    return values, np.sqrt(variance * np.sum(inverse**2, axis=1)), residual


def _friction_fit(
    friction: AbstractFriction,
    names: tuple[str, ...],
    values: Float[np.ndarray, " p"],
    stderr: Float[np.ndarray, " p"],
    residual: Float[np.ndarray, " k"],
) -> FrictionFit:
    return FrictionFit(
        friction=friction,
        names=names,
        values=values,
        stderr=stderr,
        mae=float(np.mean(np.abs(residual))),
        rmse=float(np.sqrt(np.mean(residual**2))),
        n_points=residual.size,
    )
