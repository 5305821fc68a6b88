"""Hysteresis from a cyclic record: eccentric and concentric branches, their mean, and friction."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

import famjax
from famjax import AbstractFriction, PressureFriction, ThreadFriction

from ._cycles import (
    Branch,
    checked_columns,
    choose_cycles,
    lost_work,
    pair_cycles,
    split_branches,
)
from ._errors import InputError

_ISOBAR = 0.1  # largest spread of the pressure in a record, 5th to 95th percentile over the mean


@dataclasses.dataclass(frozen=True)
class CyclicRecord:
    """The record of a muscle that is lengthened and shortened at one nominal pressure.

    Attributes:
        length: L [m], shape (n,), in order of time.
        force: F [N], shape (n,), positive when the muscle pulls.
        pressure: gauge pressure P [Pa], shape (n,).
        rest_length: L0 [m] of zero contraction.
        time: [s], shape (n,), or None.
        source: where the numbers come from.
    """

    length: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    rest_length: float
    time: Float[np.ndarray, " n"] | None = None
    source: str = "arrays"

    def __post_init__(self) -> None:
        columns = {
            "length": self.length,
            "force": self.force,
            "pressure": self.pressure,
            "time": self.time,
        }
        for name, values in checked_columns(columns).items():
            object.__setattr__(self, name, values)
        if not (np.isfinite(self.rest_length) and self.rest_length > 0):
            raise InputError(f"rest_length must be > 0 and finite, got {self.rest_length} m")
        if self.length.min() <= 0:
            raise InputError(
                f"length must be > 0, reading {int(self.length.argmin()) + 1} has "
                f"{self.length.min():.6g} m: is it a displacement or a contraction?"
            )
        low, high = np.percentile(self.pressure, [5, 95])
        if high - low > _ISOBAR * abs(self.pressure.mean()):
            raise InputError(
                f"the pressure of one record must be constant within {_ISOBAR:.0%}, it spreads "
                f"from {low:.6g} to {high:.6g} Pa: split the record by pressure; where there is "
                "none, give exact zeros"
            )

    @classmethod
    def from_contraction(
        cls,
        contraction: ArrayLike,
        force: ArrayLike,
        pressure: ArrayLike,
        *,
        rest_length: float,
        time: ArrayLike | None = None,
        source: str = "arrays",
    ) -> "CyclicRecord":
        """The record whose contraction (L0 - L)/L0 [-], a fraction, was logged."""
        return cls(
            length=rest_length * (1 - np.asarray(contraction, float)),
            force=np.asarray(force, float),
            pressure=np.asarray(pressure, float),
            rest_length=rest_length,
            time=None if time is None else np.asarray(time, float),
            source=source,
        )

    @property
    def contraction(self) -> Float[np.ndarray, " n"]:
        """Contraction (L0 - L)/L0 [-], positive when shorter."""
        return 1 - self.length / self.rest_length


@dataclasses.dataclass(frozen=True)
class HysteresisLoop:
    """The two branches of a cyclic record on one contraction grid.

    Attributes:
        contraction: grid [-], shape (points,), increasing, where both branches were measured.
        eccentric, concentric: pull [N] when the muscle lengthens and shortens, shape (points,).
        pressure: mean gauge pressure [Pa] of the two branches, shape (points,).
        pressure_difference: eccentric minus concentric [Pa], shape (points,): where it is not
            small, the controller and not the muscle makes part of the loop.
        lost_work: work [J] lost in each cycle, shape (cycles,), its loop area.
        speed: mean speed |dL/dt| [m/s], or None where no time is known.
        rest_length: L0 [m].
    """

    contraction: Float[np.ndarray, " points"]
    eccentric: Float[np.ndarray, " points"]
    concentric: Float[np.ndarray, " points"]
    pressure: Float[np.ndarray, " points"]
    pressure_difference: Float[np.ndarray, " points"]
    lost_work: Float[np.ndarray, " cycles"]
    speed: float | None
    rest_length: float

    @property
    def mean(self) -> Float[np.ndarray, " points"]:
        """Mean of the branches [N]: the static force, if friction is the same both ways."""
        return (self.eccentric + self.concentric) / 2

    @property
    def half_difference(self) -> Float[np.ndarray, " points"]:
        """Half the eccentric minus the concentric force [N]: the friction force."""
        return (self.eccentric - self.concentric) / 2

    @property
    def length(self) -> Float[np.ndarray, " points"]:
        """Active length L [m] of the grid."""
        return self.rest_length * (1 - self.contraction)


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


def hysteresis_loop(
    record: CyclicRecord,
    *,
    cycles: Sequence[int] | None = None,
    points: int = 41,
    min_travel: float = 0.5,
) -> HysteresisLoop:
    """The eccentric and concentric branches of a record on a common grid, and the work lost.

    The range that both branches cover is cut into bins of equal width. Readings of a branch, of all
    chosen cycles together, are averaged in each bin, and force and pressure taken to its middle
    along the slope between bins; curvature within a bin of width w adds F'' w^2 / 24. A bin in
    which either branch has no reading is left out.

    Args:
        record: the test at one pressure; a cycle starts in either direction.
        cycles: numbers from 1 of the cycles to use; all where None.
        points: bins of the grid, >= 3.
        min_travel: least travel of a branch as a fraction of the whole, see `split_branches`.

    Returns:
        The loop.

    Raises:
        InputError: no cycles, fewer than asked for, or too few readings that both branches share.
    """
    if points < 3:
        raise InputError(f"the grid needs at least 3 points, got {points}")
    branches = split_branches(record.length, min_travel=min_travel)
    found = pair_cycles(branches, rising_first=branches[0].rising) if branches else ()
    chosen = choose_cycles(found, range(1, max(len(found), 1) + 1) if cycles is None else cycles)
    parts = [part for cycle in chosen for part in (cycle.first, cycle.second)]
    kinds = [[part for part in parts if part.rising == rising] for rising in (True, False)]
    ranges = [record.contraction[_rows(kind)] for kind in kinds]
    low, high = max(c.min() for c in ranges), min(c.max() for c in ranges)
    edges = np.linspace(low, high, points + 1)
    lengthening, shortening = (_bin_means(record, _rows(kind), edges) for kind in kinds)
    filled = np.isfinite(lengthening[0] + shortening[0])
    if filled.sum() < 3:
        raise InputError(
            f"the branches share readings at {int(filled.sum())} of {points} contractions between "
            f"{low:.4g} and {high:.4g}, and 3 are needed: record more per branch, or ask for fewer"
        )
    grid = ((edges[:-1] + edges[1:]) / 2)[filled]
    eccentric, concentric = (
        means[1:, filled]
        + np.gradient(means[1:, filled], means[0, filled], axis=1) * (grid - means[0, filled])
        for means in (lengthening, shortening)
    )
    return HysteresisLoop(
        contraction=grid,
        eccentric=eccentric[0],
        concentric=concentric[0],
        pressure=(eccentric[1] + concentric[1]) / 2,
        pressure_difference=eccentric[1] - concentric[1],
        lost_work=np.array([lost_work(record.length, record.force, cycle) for cycle in chosen]),
        speed=_speed(record, parts),
        rest_length=record.rest_length,
    )


def _rows(branches: Sequence[Branch]) -> Int[np.ndarray, " rows"]:
    return np.concatenate([np.arange(part.start, part.stop) for part in branches])


def _bin_means(
    record: CyclicRecord, rows: Int[np.ndarray, " rows"], edges: Float[np.ndarray, " edges"]
) -> Float[np.ndarray, "3 points"]:
    """Mean contraction, force and pressure of the readings in each bin; nan in an empty one."""
    points = edges.size - 1
    columns = np.stack([record.contraction[rows], record.force[rows], record.pressure[rows]])
    columns = columns[:, (columns[0] >= edges[0]) & (columns[0] <= edges[-1])]
    number = np.digitize(columns[0], edges[1:-1])
    count = np.bincount(number, minlength=points)
    sums = np.stack([np.bincount(number, column, minlength=points) for column in columns])
    return np.where(count > 0, sums, np.nan) / np.maximum(count, 1)


def _speed(record: CyclicRecord, branches: Sequence[Branch]) -> float | None:
    if record.time is None:
        return None
    duration = sum(float(np.ptp(record.time[part.rows])) for part in branches)
    travel = sum(float(np.ptp(record.length[part.rows])) for part in branches)
    return travel / duration if duration > 0 else None


def fit_pressure_friction(loops: Sequence[HysteresisLoop], *, trim: float = 0.05) -> FrictionFit:
    """The friction c0 + c1 P that fits the half-differences of loops at several pressures best.

    Args:
        loops: at least two, at different pressures.
        trim: part of each loop's range that is left out at either end, where the motion turns
            round and friction has not fully built up.

    Returns:
        The fit, its term a `famjax.PressureFriction`.

    Raises:
        InputError: fewer than two pressures.
    """
    levels = [float(loop.pressure.mean()) for loop in loops]
    if len(loops) < 2 or np.ptp(levels) <= _ISOBAR * np.abs(levels).max():
        raise InputError(
            "a constant and a slope in pressure need loops at two pressures at least, more than "
            f"{_ISOBAR:.0%} apart; got loops at {', '.join(f'{P:.6g} Pa' for P in levels)}"
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
    geometry: famjax.AbstractGeometry,
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
        The fit, its term a `famjax.ThreadFriction`.

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
