"""Both branches of ramps and strokes by Maxwell-slip elements: `BranchPairs` in, strengths out."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError
from famjax.boundary.units import finite_or_none, from_si, unit_system
from famjax.cards import slip_as_dict
from famjax.compile_options import quick_jit
from famjax.slip import (
    CentredSlip,
    MaxwellSlip,
    ReferenceCycle,
    SlipElements,
    slip_coordinates,
    slip_shares,
    there_and_back,
)
from famjax.tables import read_table

from ..convex import Status, solve_qp
from .record import Column, check_positive, set_columns

MODULUS = 1e6
"""E [Pa] of the coordinates, the order of rubber's: see `famjax.slip.MaxwellSlip`."""
SHRINKAGE = 1e-3
"""Weight of the sum of squared strengths, in parts of the largest column's square."""
PREDICTS = 0.6
"""Error on what was left out, in parts of what was measured, above which a reader is warned."""

_ELEMENTS = 8  # thresholds on each coordinate
_OCTAVES = 7  # from the highest to the lowest of them
_COLUMNS = ("length", "pressure", "half_difference", "start_length", "start_pressure",
            "turn_length", "turn_pressure")  # fmt: skip
_GROUPS = {"record": "", "length": "_m", "pressure": "_Pa"}

Thresholds = tuple[Float[np.ndarray, " k"], Float[np.ndarray, " m"]]
"""Of the elements on the wall's coordinate and of those on the braid's."""


@dataclasses.dataclass(frozen=True)
class History:
    """Lengths and pressures in the order in which they came.

    Attributes:
        length: active length L [m], shape (n,).
        pressure: gauge pressure P [Pa], shape (n,).
        time: [s], shape (n,), or None.
        units: those of the columns, by quantity, in which answers are given; not of the values here.
    """

    length: Column
    pressure: Column
    time: Column | None = None
    units: Mapping[str, str] = dataclasses.field(
        default_factory=lambda: {"length": "m", "pressure": "Pa", "time": "s"}
    )

    def __post_init__(self) -> None:
        set_columns(self, "length", "pressure", "time", least=1)
        if (self.length <= 0).any() or (self.pressure < 0).any():
            raise InputError(
                f"lengths must be > 0 and gauge pressures >= 0, got {self.length.min():.6g} m and "
                f"{self.pressure.min():.6g} Pa at the least"
            )


def read_history(path: str | Path, columns: Mapping[str, str] | None = None) -> History:
    """The history in a file.

    Args:
        path: with the columns length and pressure and, where they are known, times; each with its unit,
            as in `time_s,length_mm,pressure_kPa`, see `famjax.tables.read_table`. Without times the rows
            are in order.
        columns: which column is which quantity, where the names do not say it.

    Returns:
        The history in SI.

    Raises:
        InputError: what is wrong with the file, with the number of the row.
    """
    table = read_table(
        path, ("length", "pressure"), optional=("time",), columns=columns, strict=True
    )
    try:
        return History(**table.columns, units=table.units)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


@dataclasses.dataclass(frozen=True)
class BranchPairs:
    """Half the difference of the branches of cycles that go from a start to a turn and back.

    A cycle is a ramp (pressure up and down at one length) or a stroke (shorter and longer at one
    pressure). Between start and turn it must move one way.

    Attributes:
        length: L [m] of the point, shape (n,).
        pressure: gauge pressure P [Pa], shape (n,).
        half_difference: (force on the way back - force on the way there) / 2 [N], shape (n,).
        start_length, start_pressure: where the cycle of the point begins, shape (n,).
        turn_length, turn_pressure: where it turns round, shape (n,).
        cycled: the same cycle went before; otherwise all is relaxed at the start, shape (n,).
        record: number of the record in `names`, shape (n,).
        names: of the records.
        rest_length: L0 [m] of the muscle.
    """

    length: Column
    pressure: Column
    half_difference: Column
    start_length: Column
    start_pressure: Column
    turn_length: Column
    turn_pressure: Column
    cycled: Bool[np.ndarray, " n"]
    record: Int[np.ndarray, " n"]
    names: tuple[str, ...]
    rest_length: float

    def __post_init__(self) -> None:
        if not np.size(self.length):
            raise InputError(
                "hysteresis needs points at which both branches pull, and there is none: record "
                "both, filling and venting or shortening and lengthening"
            )
        set_columns(self, *_COLUMNS, least=1)
        check_positive(rest_length=self.rest_length)
        lengths = np.concatenate([self.length, self.start_length, self.turn_length])
        if (lengths <= 0).any():
            raise InputError(f"lengths must be > 0, got {lengths.min():.6g} m")
        for name, unit in (("length", "m"), ("pressure", "Pa")):
            at, start, turn = (getattr(self, f"{place}{name}") for place in ("", "start_", "turn_"))
            outside = np.flatnonzero((at - start) * (at - turn) > 0)
            if outside.size:
                k = outside[0]
                raise InputError(
                    f"the points of a cycle lie between its start and its turn, {start[k]:.6g} and "
                    f"{turn[k]:.6g} {unit}, got {at[k]:.6g} {unit}"
                )

    @classmethod
    def ramp(
        cls,
        length: float,
        pressure: Column,
        half_difference: Column,
        *,
        turn_pressure: float,
        rest_length: float,
        name: str = "ramp",
    ) -> "BranchPairs":
        """Branch pairs of one record at constant length that starts vented.

        Args:
            length: L [m].
            pressure: gauge pressures [Pa] of the points, shape (n,).
            half_difference: (vent - fill)/2 [N] there, shape (n,).
            turn_pressure: highest gauge pressure [Pa] of the record.
            rest_length: L0 [m].
            name: of the record.

        Raises:
            InputError: no points, or one that is beyond the turn.
        """
        ends = (length, 0.0), (length, turn_pressure)
        return cls._cycle(length, pressure, half_difference, *ends, False, name, rest_length)

    @classmethod
    def stroke(
        cls,
        length: Column,
        pressure: Column,
        half_difference: Column,
        *,
        longest: float,
        shortest: float,
        rest_length: float,
        cycled: bool = True,
        name: str = "stroke",
    ) -> "BranchPairs":
        """Branch pairs of strokes at one nominal pressure, such as an `Isobar` holds.

        Args:
            length: L [m] of the points, shape (n,).
            pressure: gauge pressure [Pa], shape (n,).
            half_difference: (lengthening - shortening)/2 [N], shape (n,).
            longest: length [m] at which the stroke starts.
            shortest: length [m] at which it turns.
            rest_length: L0 [m].
            cycled: other strokes went before, as where a curve is the mean of several.
            name: of the record.

        Raises:
            InputError: no points, or one that is beyond the ends.
        """
        ends = (longest, pressure), (shortest, pressure)
        return cls._cycle(length, pressure, half_difference, *ends, cycled, name, rest_length)

    @classmethod
    def _cycle(
        cls, length: Any, pressure: Any, half: Any, start: Any, turn: Any, cycled: bool, name: str,
        rest_length: float,
    ) -> "BranchPairs":  # fmt: skip
        n = np.size(pressure)
        values = (length, pressure, half, *start, *turn)
        return cls(
            **{key: np.full(n, value, float) for key, value in zip(_COLUMNS, values, strict=True)},
            cycled=np.full(n, cycled), record=np.zeros(n, int), names=(name,),
            rest_length=float(rest_length),
        )  # fmt: skip

    @classmethod
    def joined(cls, parts: Sequence["BranchPairs"]) -> "BranchPairs":
        """All of several records of one muscle.

        Raises:
            InputError: no records, or of muscles with different rest lengths.
        """
        if len({one.rest_length for one in parts}) != 1:
            raise InputError(
                f"records of one muscle have one rest length, got {len(parts)} records with "
                f"{sorted({one.rest_length for one in parts})} m"
            )
        first = np.cumsum([0, *(len(one.names) for one in parts)])
        return cls(
            **{name: np.concatenate([getattr(one, name) for one in parts])
               for name in (*_COLUMNS, "cycled")},
            record=np.concatenate([k + one.record for k, one in zip(first, parts, strict=False)]),
            names=tuple(name for one in parts for name in one.names),
            rest_length=parts[0].rest_length,
        )  # fmt: skip

    def at(self, rows: Bool[np.ndarray, " n"]) -> "BranchPairs":
        """The points of a mask."""
        kept = (*_COLUMNS, "cycled", "record")
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in kept})

    @property
    def is_ramp(self) -> Bool[np.ndarray, " n"]:
        """The point is of a ramp, not of a stroke, shape (n,)."""
        return self.start_length == self.turn_length

    @property
    def measured_rms(self) -> float:
        """Root mean square [N] of the half-differences."""
        return _rms(self.half_difference)


def _rms(values: Column) -> float:
    return float(np.sqrt(np.mean(values**2)))


def threshold_grid(pairs: BranchPairs, modulus: float = MODULUS) -> Thresholds:
    """Eight thresholds on each coordinate, each twice the one before.

    The highest is half the largest range of a record: only below it an element slides both ways.
    A coordinate that no record moves has none.

    Args:
        pairs: the records.
        modulus: E [Pa].
    """
    start, turn = (_coordinates(pairs, place, modulus) for place in ("start_", "turn_"))
    ranges = [float(np.abs(b - a).max()) for a, b in zip(start, turn, strict=True)]
    factors = 2.0 ** np.linspace(-_OCTAVES, 0, _ELEMENTS)
    wall, braid = (span / 2 * factors if span > 0 else np.zeros(0) for span in ranges)
    return wall, braid


def half_difference_columns(
    pairs: BranchPairs, thresholds: Thresholds, modulus: float
) -> Float[np.ndarray, "n elements"]:
    """Half-difference [N] of each element per strength, in the order of the thresholds."""
    start, at, turn = (_coordinates(pairs, place, modulus) for place in ("start_", "", "turn_"))
    shares = slip_shares(pairs.pressure, modulus)
    columns = []
    for k, delta in enumerate(thresholds):
        before = np.where(pairs.cycled, turn[k], start[k])
        out, home = there_and_back([start[k], before, start[k], at[k], turn[k], at[k]], delta)
        columns.append(np.asarray(shares[k])[:, None] * np.asarray(home - out) / 2 / delta)
    return np.concatenate(columns, axis=1)


def _coordinates(pairs: BranchPairs, place: str, modulus: float) -> tuple[Column, Column]:
    """Of wall and braid at the start, at the turn or at the point."""
    L, P = (getattr(pairs, f"{place}{name}") for name in ("length", "pressure"))
    wall, braid = slip_coordinates(L, P, pairs.rest_length, modulus)
    return np.asarray(wall), np.asarray(braid)


@dataclasses.dataclass(frozen=True)
class HysteresisLeftOut:
    """Half-differences predicted for points whose group was left out of the fit.

    Attributes:
        groups: what was left out at a time: record, length or pressure.
        values: of the groups: number of the record, length [m] or pressure [Pa], shape (groups,).
        predicted: half-difference [N], shape (n,).
        measured: the same as measured, shape (n,).
        group_rms: root mean square error [N] of each group, shape (groups,).
    """

    groups: str
    values: Float[np.ndarray, " groups"]
    predicted: Column
    measured: Column
    group_rms: Float[np.ndarray, " groups"]

    @property
    def rms(self) -> float:
        """Root mean square error [N] of the predictions."""
        return _rms(self.predicted - self.measured)

    @property
    def ratio(self) -> float:
        """That error in parts of the root mean square of what was measured."""
        return self.rms / _rms(self.measured)


@dataclasses.dataclass(frozen=True)
class HysteresisFit:
    """Hysteresis identified from pairs of branches.

    Attributes:
        centred: the elements, about the middle of the records' cycles.
        pairs: what it was fitted to.
        predicted: half-difference [N] of the fit, shape (n,).
        kkt_residual: largest violation of the optimality conditions, relative to the data.
        duality_gap: relative to the objective.
        left_out: predictions of what was left out of the fit; none before
            `leave_out`.
    """

    centred: CentredSlip
    pairs: BranchPairs
    predicted: Column
    kkt_residual: float
    duality_gap: float
    left_out: tuple[HysteresisLeftOut, ...] = ()

    @property
    def slip(self) -> MaxwellSlip:
        """The elements alone."""
        return self.centred.slip

    @property
    def rms(self) -> float:
        """Root mean square error [N] of the half-difference."""
        return _rms(self.predicted - self.pairs.half_difference)

    def half_difference(self, pairs: BranchPairs) -> Column:
        """Half-difference [N] that the fit predicts for other points, shape (n,)."""
        sides = (self.slip.wall, self.slip.braid)
        wall, braid = (np.asarray(one.threshold, float) for one in sides)
        strength = np.concatenate([np.asarray(one.strength, float) for one in sides])
        return half_difference_columns(pairs, (wall, braid), float(self.slip.modulus)) @ strength

    def heat(self, record: int) -> float:
        """Energy [J] that a closed cycle of a record loses by the fit, from start to turn and back.

        It comes from the fluid in a ramp and from the machine in a stroke. Of a cycled record it is
        that of the cycle which repeats itself.
        """
        at = int(np.flatnonzero(self.pairs.record == record)[0])
        start, turn = (
            [float(getattr(self.pairs, f"{end}_{name}")[at]) for name in ("length", "pressure")]
            for end in ("start", "turn")
        )
        once, twice = (
            float(self.slip.heat(*np.array([start, *[turn, start] * cycles]).T))
            for cycles in (1, 2)
        )
        return twice - once if self.pairs.cycled[at] else once


def fit_hysteresis(
    pairs: BranchPairs,
    *,
    thresholds: Thresholds | None = None,
    cycle: ReferenceCycle | None = None,
    modulus: float = MODULUS,
    shrinkage: float = SHRINKAGE,
) -> HysteresisFit:
    """The non-negative strengths whose half-differences are nearest to those measured.

        minimise 1/2 |A S - h|^2 + 1/2 r |a|^2 |S|^2   subject to   S >= 0

    At fixed thresholds the force is linear in the strengths S, so that the optimum is that of a
    convex programme and global. The second term, a the largest column of A, chooses among strengths
    that the records cannot tell apart, and leaves at zero those of elements that no record moves.

    Args:
        pairs: of ramps, strokes or both.
        thresholds: of the elements on wall and braid; None for `threshold_grid`.
        cycle: whose middle the static map is; None for that of the records, if they are of one kind.
        modulus: E [Pa] of the coordinates.
        shrinkage: r [-], > 0 unless the records tell all elements apart.

    Returns:
        The fit.

    Raises:
        InputError: thresholds or a modulus that are not positive, ramps and strokes without a
            `cycle`, or elements that the records cannot tell apart and no shrinkage.
    """
    if not (np.isfinite(modulus) and modulus > 0 and shrinkage >= 0):
        raise InputError(
            f"modulus must be > 0 and shrinkage >= 0, got {modulus} Pa and {shrinkage}"
        )
    wall, braid = threshold_grid(pairs, modulus) if thresholds is None else thresholds
    for values in (wall, braid):
        if not (np.isfinite(values).all() and (values > 0).all()):
            raise InputError(f"thresholds must be > 0 and finite, got {values}")
    columns = half_difference_columns(pairs, (wall, braid), modulus)
    n = columns.shape[1]
    size = np.sqrt(shrinkage) * float(np.linalg.norm(columns, axis=0).max(initial=0.0))
    A = np.concatenate([columns, size * np.eye(n)])
    b = np.concatenate([pairs.half_difference, np.zeros(n)])
    G, h = np.eye(n), np.zeros(n)
    optimum = quick_jit(solve_qp)(A, b, G, h)
    if int(optimum.status) != Status.OPTIMAL:
        raise InputError(
            f"the records do not tell {n} elements apart: give a shrinkage, or fewer thresholds "
            "than turning points reach"
        )
    strength = np.maximum(np.asarray(optimum.x), 0.0)
    strength[np.asarray(optimum.active)] = 0.0  # active: what is left is rounding
    model = MaxwellSlip(
        SlipElements(wall, strength[: wall.size]),
        SlipElements(braid, strength[wall.size :]),
        pairs.rest_length,
        modulus,
    )
    return HysteresisFit(
        centred=CentredSlip(model, _cycle_of(pairs) if cycle is None else cycle),
        pairs=pairs,
        predicted=columns @ strength,
        kkt_residual=float(optimum.kkt_residual),
        duality_gap=float(optimum.duality_gap),
    )


def _cycle_of(pairs: BranchPairs) -> ReferenceCycle:
    """The cycle of records of one kind, its ends the median of theirs."""
    kinds = np.unique(pairs.is_ramp)
    if kinds.size > 1:
        raise InputError(
            "of ramps and strokes together it is not known which the static map is the mean of: "
            "give the cycle"
        )
    quantity = "pressure" if kinds[0] else "length"
    start, turn = (
        float(np.median(getattr(pairs, f"{end}_{quantity}"))) for end in ("start", "turn")
    )
    return ReferenceCycle(
        "ramp" if kinds[0] else "stroke", start, turn, bool(np.mean(pairs.cycled) > 0.5)
    )


def leave_out(fit: HysteresisFit) -> HysteresisFit:
    """The fit with what it predicts of each record, length and pressure that is left out of it.

    Thresholds are chosen anew from what is left. Whatever there is only one of cannot be left out;
    the pressures are those of strokes.

    Args:
        fit: of `fit_hysteresis`.

    Returns:
        The same fit with `left_out`.
    """
    pairs = fit.pairs
    kinds = {"record": pairs.record.astype(float)}
    for quantity, moves in (("length", ~pairs.is_ramp), ("pressure", pairs.is_ramp)):
        values = getattr(pairs, quantity)
        numbers, each = np.unique(pairs.record, return_inverse=True)
        medians = np.array([np.median(values[pairs.record == number]) for number in numbers])
        kinds[quantity] = np.where(moves, np.nan, medians[each])
    found = [
        _left_out(fit, kind, group)
        for kind, group in kinds.items()
        if np.isfinite(group).all() and np.unique(group).size > 1
    ]
    return dataclasses.replace(fit, left_out=tuple(found))


def _left_out(fit: HysteresisFit, kind: str, group: Column) -> HysteresisLeftOut:
    pairs, measured = fit.pairs, fit.pairs.half_difference
    predicted, values = np.zeros(measured.size), np.unique(group)
    for value in values:
        out = group == value
        without = fit_hysteresis(
            pairs.at(~out), cycle=fit.centred.cycle, modulus=float(fit.slip.modulus)
        )
        predicted[out] = without.half_difference(pairs.at(out))
    errors = [predicted[group == value] - measured[group == value] for value in values]
    return HysteresisLeftOut(
        groups=kind,
        values=values,
        predicted=predicted,
        measured=measured,
        group_rms=np.array([_rms(error) for error in errors]),
    )


def hysteresis_as_dict(fit: HysteresisFit) -> dict[str, Any]:
    """The fit as JSON-ready data in SI; `famjax.cards.slip_from_dict` reads its elements."""
    pairs = fit.pairs
    records = np.unique(pairs.record).tolist()
    return {
        **slip_as_dict(fit.centred),
        "n_points": int(pairs.half_difference.size),
        "measured_rms_N": pairs.measured_rms,
        "rms_N": fit.rms,
        "left_out": {
            one.groups: {
                "rms_N": one.rms,
                "ratio": finite_or_none(one.ratio),
                f"values{_GROUPS[one.groups]}": one.values.tolist(),
                "group_rms_N": one.group_rms.tolist(),
            }
            for one in fit.left_out
        },
        "kkt_residual": fit.kkt_residual,
        "duality_gap": fit.duality_gap,
        "records": [pairs.names[k] for k in records],
        "lost_energy_J": [fit.heat(k) for k in records],
    }


def hysteresis_table(
    fit: HysteresisFit, system: str
) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    """The fit as a table of text in a unit system: title, header, rows."""
    unit, measured = unit_system(system)["force"], fit.pairs.measured_rms

    def row(name: str, value: float) -> tuple[str, str, str]:
        share = f"{100 * value / measured:.3g} %" if measured > 0 else "none"
        return name, f"{from_si(value, unit, 'force'):.4g}", share

    lost = [1e3 * fit.heat(k) for k in np.unique(fit.pairs.record).tolist()]
    n = sum(
        int(np.sum(np.asarray(getattr(fit.slip, name).strength) > 0)) for name in ("wall", "braid")
    )
    rows = [
        row("measured", measured),
        row("error of the fit", fit.rms),
        *(row(f"error with one {one.groups} left out", one.rms) for one in fit.left_out),
        ("elements with a strength", str(n), ""),
        ("energy lost per cycle, mJ", f"{min(lost):.3g} to {max(lost):.3g}", ""),
        ("KKT residual", f"{fit.kkt_residual:.1e}", ""),
        ("duality gap", f"{fit.duality_gap:.1e}", ""),
    ]
    title = (
        f"Hysteresis: half the difference of the branches, RMS over {fit.pairs.record.size} points"
    )
    return title, ("", unit, "of measured"), rows


def hysteresis_warnings(fit: HysteresisFit) -> tuple[str, ...]:
    """Where the hysteresis is not to be relied on."""
    found = []
    strength = np.concatenate(
        [np.asarray(getattr(fit.slip, name).strength) for name in ("wall", "braid")]
    )
    if not (strength > 0).any():
        found.append(
            "No element of the hysteresis has a strength: the branches lie the other way round, or "
            "at rest length alone, where the model has no loop."
        )
    found += [
        f"The hysteresis does not predict a {one.groups} that was left out: its error is "
        f"{one.ratio:.0%} of the half-difference measured."
        for one in fit.left_out
        if not one.ratio <= PREDICTS
    ]
    if not fit.left_out:
        found.append(
            "There is one record at one length: the hysteresis could not be tested on another."
        )
    return tuple(found)
