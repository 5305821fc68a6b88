"""Characterisation of a muscle at constant pressures: curves, ends, hysteresis, pressure held."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from famjax.boundary.errors import InputError

from .branch import (
    branch,
    contraction_at_zero,
    force_at_rest,
    held_force,
    hole,
    pressure_variance,
)
from .isobaric_record import IsobaricRecord
from .stroke import Stroke, strokes

GRID = 100
"""Lengths at which the branches are compared."""


@dataclasses.dataclass(frozen=True)
class Isobar:
    """What was measured at one set pressure, in SI; nan where it was not.

    Attributes:
        set_pressure: gauge [Pa].
        pressure: mean of the measured pressure during the strokes [Pa].
        pressure_std: its standard deviation [Pa] (Chambers 2021, tables 3.3 and 3.4).
        largest_pressure_error: largest deviation from the set pressure [Pa].
        cycles: strokes that the curves are means of.
        length: active lengths [m], falling from near the longest, shape (n,).
        shortening: F [N] of the concentric branch, shape (n,).
        lengthening: F [N] of the eccentric branch, shape (n,).
        shortening_pressure, lengthening_pressure: measured there [Pa], shape (n,): the pressure dips
            at a turn and rises at the other, so that no branch is at one pressure.
        bin_pressure_std: scatter of the readings of the pressure about it, within a step of the grid
            [Pa], shape (n,).
        force_std: scatter of the mean of both branches from stroke to stroke [N], shape (n,); nan
            for one stroke.
        blocked_force: mean F [N] while the muscle was held at rest before its first stroke, for half a
            second at least; it keeps the friction of what came before.
        blocked_force_std: scatter of F [N] while it was held.
        moving_blocked_force: F [N] of the mean curve at the rest length, which a dip of the pressure
            at the turn lowers.
        free_contraction: (L0 - L)/L0 at which the shortening muscle has no force left.
        free_contraction_std: its scatter from stroke to stroke.
        mean_free_contraction: the same of the mean curve, nan where the machine turned before.
        hysteresis: work lost in a stroke [J], the area between the branches.
        hysteresis_ratio: that area over the one under the mean curve.
    """

    set_pressure: float
    pressure: float
    pressure_std: float
    largest_pressure_error: float
    cycles: int
    length: np.ndarray
    shortening: np.ndarray
    lengthening: np.ndarray
    shortening_pressure: np.ndarray
    lengthening_pressure: np.ndarray
    bin_pressure_std: np.ndarray
    force_std: np.ndarray
    blocked_force: float
    blocked_force_std: float
    moving_blocked_force: float
    free_contraction: float
    free_contraction_std: float
    mean_free_contraction: float
    hysteresis: float
    hysteresis_ratio: float

    @property
    def force(self) -> np.ndarray:
        """The mean curve F [N], half the sum of both branches, shape (n,)."""
        return (self.shortening + self.lengthening) / 2


@dataclasses.dataclass(frozen=True)
class Characterisation:
    """A muscle at several constant pressures.

    Attributes:
        isobars: by rising set pressure.
        rest_length: L0 [m].
        notes: what was left out.
    """

    isobars: tuple[Isobar, ...]
    rest_length: float
    notes: tuple[str, ...] = ()

    def rows(self) -> list[dict[str, float]]:
        """The figures of every isobar, with the unit in each key."""
        units = {
            "set_pressure": "Pa", "pressure": "Pa", "pressure_std": "Pa",
            "largest_pressure_error": "Pa", "cycles": "", "blocked_force": "N",
            "blocked_force_std": "N", "moving_blocked_force": "N", "free_contraction": "",
            "free_contraction_std": "", "mean_free_contraction": "", "hysteresis": "J",
            "hysteresis_ratio": "",
        }  # fmt: skip
        return [
            {f"{name}_{unit}" if unit else name: getattr(bar, name) for name, unit in units.items()}
            for bar in self.isobars
        ]


def characterise(
    record: IsobaricRecord, *, skip_cycles: int = 0, grid: int = GRID
) -> Characterisation:
    """Curves and figures at every set pressure of a record, neglecting the strokes' finite rate.

    Branches are local straight lines on a grid of lengths that every stroke at that pressure covers,
    each over two steps of the grid; strokes are averaged there.

    Args:
        record: of the test.
        skip_cycles: first strokes at each pressure that are left out.
        grid: number of lengths.

    Returns:
        The characterisation, by rising set pressure.

    Raises:
        InputError: there is no complete stroke.

    References:
        Chambers 2021, sections 3.3 and 4.3, tables 3.3 and 3.4.
    """
    if grid < 10 or skip_cycles < 0:
        raise InputError(f"grid >= 10 and skip_cycles >= 0 must hold, got {grid} and {skip_cycles}")
    found, notes = strokes(record)
    by_pressure: dict[float, list[Stroke]] = {}
    for stroke in found:
        if stroke.number < skip_cycles:
            continue
        lacks = max(hole(record, rows, grid) for rows in (stroke.shortening, stroke.lengthening))
        if lacks:
            notes.append(
                f"At {stroke.set_pressure:.6g} Pa stroke {stroke.number + 1} lacks {lacks:.3g} s in "
                "the journal or the log and was left out."
            )
        else:
            by_pressure.setdefault(stroke.set_pressure, []).append(stroke)
    if not by_pressure:
        raise InputError(
            f"no complete stroke in {record.time.size} rows over "
            f"{record.time[-1] - record.time[0]:.5g} s, lengths {record.length.min():.5g} to "
            f"{record.length.max():.5g} m, skipping {skip_cycles} cycles: check that journal and log are "
            "of one test, and whole (famjax rig check). " + " ".join(notes)
        )
    isobars = []
    for pressure in sorted(by_pressure):
        try:
            isobars.append(_isobar(record, by_pressure[pressure], grid))
        except InputError as error:
            # A muscle that is slack soon turns soon: a short stroke has few rows.
            notes.append(f"The strokes at {pressure:.6g} Pa were left out: {error}")
    if not isobars:
        raise InputError(notes[-1])
    return Characterisation(tuple(isobars), record.rest_length, (*record.notes, *notes))


def force_rmse(one: Characterisation, other: Characterisation) -> Mapping[float, float]:
    """Root mean square difference of two characterisations' forces, by set pressure.

    sqrt(mean (F_1 - F_2)^2) over both branches, at the lengths that both cover.

    Returns:
        Set pressure [Pa] -> difference [N], for the pressures that both hold.

    Raises:
        InputError: no set pressure is common, or no length at one.

    References:
        Chambers 2021, equation 3.8 and table 3.5.
    """
    others = {bar.set_pressure: bar for bar in other.isobars}
    found = {}
    for a in one.isobars:
        b = others.get(a.set_pressure)
        if b is None:
            continue
        low, high = max(a.length[-1], b.length[-1]), min(a.length[0], b.length[0])
        if low >= high:
            raise InputError(
                f"at {a.set_pressure:.6g} Pa the lengths have nothing in common: {a.length[-1]:.5g} to "
                f"{a.length[0]:.5g} m and {b.length[-1]:.5g} to {b.length[0]:.5g} m"
            )
        at = np.linspace(low, high, GRID)
        left = [
            np.interp(at, a.length[::-1], getattr(a, branch)[::-1])
            - np.interp(at, b.length[::-1], getattr(b, branch)[::-1])
            for branch in ("shortening", "lengthening")
        ]
        found[a.set_pressure] = float(np.sqrt(np.mean(np.square(left))))
    if not found:
        raise InputError(
            "no set pressure is common: "
            f"{', '.join(f'{bar.set_pressure:.6g}' for bar in one.isobars)} Pa and "
            f"{', '.join(f'{P:.6g}' for P in others)} Pa"
        )
    return found


def _isobar(record: IsobaricRecord, found: list[Stroke], grid: int) -> Isobar:
    lengths = record.length
    sides = [[s.shortening for s in found], [s.lengthening for s in found]]
    shortest = max(lengths[rows].min() for side in sides for rows in side)
    longest = min(lengths[rows].max() for side in sides for rows in side)
    at = np.linspace(longest, shortest, grid)
    width = (longest - shortest) / (grid - 1)
    down, up = (np.array([branch(record, rows, at, width) for rows in side]) for side in sides)
    mean = (down + up) / 2
    pressures = [[branch(record, rows, at, width, "pressure") for rows in side] for side in sides]
    variance = [
        pressure_variance(record, rows, at, width, curve)
        for side, curves in zip(sides, pressures, strict=True)
        for rows, curve in zip(side, curves, strict=True)
    ]
    held = held_force(record, found[0])
    free = np.array([_free_contraction(record, s, grid) for s in found])
    inside = np.concatenate(
        [record.pressure[s.shortening.start : s.lengthening.stop] for s in found]
    )
    whole = mean.mean(axis=0)
    lost = float(np.trapezoid((up - down).mean(axis=0), -at))
    return Isobar(
        set_pressure=found[0].set_pressure,
        pressure=float(inside.mean()),
        pressure_std=float(inside.std()),
        largest_pressure_error=float(np.abs(inside - found[0].set_pressure).max()),
        cycles=len(found),
        length=at,
        shortening=down.mean(axis=0),
        lengthening=up.mean(axis=0),
        shortening_pressure=np.mean(pressures[0], axis=0),
        lengthening_pressure=np.mean(pressures[1], axis=0),
        bin_pressure_std=np.sqrt(np.mean(variance, axis=0)),
        force_std=_scatter(mean),
        blocked_force=float(held.mean()) if held.size else float("nan"),
        blocked_force_std=float(held.std()) if held.size else float("nan"),
        moving_blocked_force=force_at_rest(at, whole, record.rest_length, width),
        free_contraction=float(free.mean()),
        free_contraction_std=float(_scatter(free)),
        mean_free_contraction=contraction_at_zero(record.rest_length, at, whole),
        hysteresis=lost,
        hysteresis_ratio=lost / float(np.trapezoid(whole, -at)),
    )


def _free_contraction(record: IsobaricRecord, stroke: Stroke, grid: int) -> float:
    """Contraction at which one shortening muscle has no force left, over all of its own lengths."""
    length = record.length[stroke.shortening]
    at, width = np.linspace(length.max(), length.min(), grid, retstep=True)
    curve = branch(record, stroke.shortening, at, abs(float(width)))
    return contraction_at_zero(record.rest_length, at, curve)


def _scatter(values: np.ndarray) -> np.ndarray:
    return (
        np.asarray(values.std(axis=0, ddof=1))
        if len(values) > 1
        else np.full(values.shape[1:], np.nan)
    )
