"""Hysteresis of ramps and strokes, fitted by Maxwell-slip elements."""

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
"""Modulus E [Pa] of the coordinates, of the order of rubber: see `famjax.slip.MaxwellSlip`."""
SHRINKAGE = 1e-3
"""Weight of the sum of squared strengths, relative to the largest squared column norm."""
PREDICTS = 0.6
"""Largest held-out error, relative to the measured half-difference, without a warning."""

_ELEMENTS = 8  # thresholds on each coordinate
_OCTAVES = 7  # between the lowest and the highest threshold
_COLUMNS = ("length", "pressure", "half_difference", "start_length", "start_pressure",
            "turn_length", "turn_pressure")  # fmt: skip
_GROUPS = {"record": "", "length": "_m", "pressure": "_Pa"}

Thresholds = tuple[Float[np.ndarray, " k"], Float[np.ndarray, " m"]]
"""Thresholds of the elements on the wall coordinate and on the braid coordinate."""


@dataclasses.dataclass(frozen=True)
class History:
    """Lengths and pressures in chronological order.

    Attributes:
        length: active length L [m], shape (n,).
        pressure: gauge pressure P [Pa], shape (n,).
        time: times [s], shape (n,), or None.
        units: unit of each column in the file, used for output; the values here are in SI.
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
                f"lengths must be > 0 and gauge pressures >= 0, got a smallest length of "
                f"{self.length.min():.6g} m and a smallest pressure of {self.pressure.min():.6g} Pa"
            )


def read_history(path: str | Path, columns: Mapping[str, str] | None = None) -> History:
    """Read a history from a file.

    Args:
        path: file with columns for length, pressure and optionally time, each with its unit, as in
            `time_s,length_mm,pressure_kPa`, see `famjax.tables.read_table`. Rows are in chronological
            order.
        columns: column name of each quantity that cannot be recognised.

    Returns:
        The history in SI.

    Raises:
        InputError: the file is invalid; the message names the row.
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
    """Half-differences between the two branches of cycles from a start to a turning point and back.

    A cycle is a ramp (pressure up and down at constant length) or a stroke (shortening and lengthening at
    constant pressure). It must be monotonic between start and turning point.

    Attributes:
        length: length L [m] of each point, shape (n,).
        pressure: gauge pressure P [Pa], shape (n,).
        half_difference: (force on the way back - force on the way out) / 2 [N], shape (n,).
        start_length, start_pressure: start of the point's cycle, shape (n,).
        turn_length, turn_pressure: turning point of the cycle, shape (n,).
        cycled: True if the same cycle preceded, shape (n,); otherwise all elements are relaxed at the
            start.
        record: index of the record in `names`, shape (n,).
        names: names of the records.
        rest_length: rest length L0 [m] of the muscle.
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
                "hysteresis requires points at which both branches pull, got none: record both filling "
                "and venting, or both shortening and lengthening"
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
                    f"the points of a cycle must be between its start and its turning point, "
                    f"{start[k]:.6g} and {turn[k]:.6g} {unit}, got {at[k]:.6g} {unit}"
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
            length: constant length L [m].
            pressure: gauge pressures [Pa] of the points, shape (n,).
            half_difference: (vent - fill)/2 [N] at the points, shape (n,).
            turn_pressure: highest gauge pressure [Pa] of the record.
            rest_length: rest length L0 [m].
            name: name of the record.

        Raises:
            InputError: there are no points, or a point is beyond the turning point.
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
            length: length L [m] of each point, shape (n,).
            pressure: gauge pressure [Pa], shape (n,).
            half_difference: (lengthening - shortening)/2 [N], shape (n,).
            longest: length [m] at which the stroke starts.
            shortest: length [m] at the turning point.
            rest_length: rest length L0 [m].
            cycled: True if other strokes preceded, as in a mean over several strokes.
            name: name of the record.

        Raises:
            InputError: there are no points, or a point is beyond the ends.
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
        """Join the records of one muscle.

        Raises:
            InputError: there are no records, or their rest lengths differ.
        """
        if len({one.rest_length for one in parts}) != 1:
            raise InputError(
                f"records of one muscle must have the same rest length, got {len(parts)} records with "
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
        """Return the selected points."""
        kept = (*_COLUMNS, "cycled", "record")
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in kept})

    @property
    def is_ramp(self) -> Bool[np.ndarray, " n"]:
        """True for points of ramps, False for points of strokes, shape (n,)."""
        return self.start_length == self.turn_length

    @property
    def measured_rms(self) -> float:
        """Root mean square [N] of the half-differences."""
        return _rms(self.half_difference)


def _rms(values: Column) -> float:
    return float(np.sqrt(np.mean(values**2)))


def threshold_grid(pairs: BranchPairs, modulus: float = MODULUS) -> Thresholds:
    """Return eight thresholds on each coordinate, each twice the previous one.

    The highest is half the largest range of a record, since only elements below it slide both ways. A
    coordinate that does not change in any record has no thresholds.

    Args:
        pairs: the records.
        modulus: modulus E [Pa] of the coordinates.
    """
    start, turn = (_coordinates(pairs, place, modulus) for place in ("start_", "turn_"))
    ranges = [float(np.abs(b - a).max()) for a, b in zip(start, turn, strict=True)]
    factors = 2.0 ** np.linspace(-_OCTAVES, 0, _ELEMENTS)
    wall, braid = (span / 2 * factors if span > 0 else np.zeros(0) for span in ranges)
    return wall, braid


def half_difference_columns(
    pairs: BranchPairs, thresholds: Thresholds, modulus: float
) -> Float[np.ndarray, "n elements"]:
    """Half-difference [N] of each element per unit strength, in the order of the thresholds."""
    start, at, turn = (_coordinates(pairs, place, modulus) for place in ("start_", "", "turn_"))
    shares = slip_shares(pairs.pressure, modulus)
    columns = []
    for k, delta in enumerate(thresholds):
        before = np.where(pairs.cycled, turn[k], start[k])
        out, home = there_and_back([start[k], before, start[k], at[k], turn[k], at[k]], delta)
        columns.append(np.asarray(shares[k])[:, None] * np.asarray(home - out) / 2 / delta)
    return np.concatenate(columns, axis=1)


def _coordinates(pairs: BranchPairs, place: str, modulus: float) -> tuple[Column, Column]:
    """Wall and braid coordinates at the start ("start_"), turning point ("turn_") or point ("")."""
    L, P = (getattr(pairs, f"{place}{name}") for name in ("length", "pressure"))
    wall, braid = slip_coordinates(L, P, pairs.rest_length, modulus)
    return np.asarray(wall), np.asarray(braid)


@dataclasses.dataclass(frozen=True)
class HysteresisLeftOut:
    """Half-differences predicted for held-out groups.

    Attributes:
        groups: kind of group: record, length or pressure.
        values: record number, length [m] or pressure [Pa] of each group, shape (groups,).
        predicted: predicted half-difference [N], shape (n,).
        measured: measured half-difference [N], shape (n,).
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
        """That error relative to the root mean square of the measured values."""
        return self.rms / _rms(self.measured)


@dataclasses.dataclass(frozen=True)
class HysteresisFit:
    """Hysteresis identified from pairs of branches.

    Attributes:
        centred: elements, centred on the middle of the records' cycles.
        pairs: fitted data.
        predicted: half-difference [N] of the fit, shape (n,).
        kkt_residual: largest violation of the optimality conditions, relative to the data.
        duality_gap: duality gap relative to the objective.
        left_out: held-out predictions; empty before `leave_out`.
    """

    centred: CentredSlip
    pairs: BranchPairs
    predicted: Column
    kkt_residual: float
    duality_gap: float
    left_out: tuple[HysteresisLeftOut, ...] = ()

    @property
    def slip(self) -> MaxwellSlip:
        """Elements without the reference cycle."""
        return self.centred.slip

    @property
    def rms(self) -> float:
        """Root mean square error [N] of the half-difference."""
        return _rms(self.predicted - self.pairs.half_difference)

    def half_difference(self, pairs: BranchPairs) -> Column:
        """Predict the half-difference [N] at other points, shape (n,)."""
        sides = (self.slip.wall, self.slip.braid)
        wall, braid = (np.asarray(one.threshold, float) for one in sides)
        return half_difference_columns(pairs, (wall, braid), float(self.slip.modulus)) @ _strengths(
            self
        )

    def heat(self, record: int) -> float:
        """Energy [J] lost in a closed cycle of a record according to the fit.

        The fluid supplies it in a ramp, the machine in a stroke. For a cycled record, the value is that
        of the repeating cycle.
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
    """Fit the non-negative strengths of slip elements to measured half-differences.

        minimise 1/2 |A S - h|^2 + 1/2 r |a|^2 |S|^2   subject to   S >= 0

    At fixed thresholds the force is linear in the strengths S, so the programme is convex and its optimum
    is global. The second term, with a the largest column of A, selects among strengths that the records do
    not determine, and keeps elements that never move at zero.

    Args:
        pairs: branches of ramps, strokes or both.
        thresholds: thresholds of the elements on wall and braid; None for `threshold_grid`.
        cycle: cycle whose mean the static map is; None to derive it from records of one kind.
        modulus: modulus E [Pa] of the coordinates.
        shrinkage: weight r [-]; may be 0 only if the records determine all elements.

    Returns:
        The fit.

    Raises:
        InputError: thresholds or modulus are not positive, `cycle` is missing for a mixture of ramps and
            strokes, or the records do not determine all elements and there is no shrinkage.
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
            f"the records do not determine {n} elements: use a shrinkage > 0, or fewer thresholds"
        )
    strength = np.maximum(np.asarray(optimum.x), 0.0)
    strength[np.asarray(optimum.active)] = 0.0  # remove rounding at active constraints
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
    """Return the median cycle of records of one kind."""
    kinds = np.unique(pairs.is_ramp)
    if kinds.size > 1:
        raise InputError(
            "ramps and strokes together do not determine the cycle of the static map: give the argument "
            "cycle"
        )
    quantity = "pressure" if kinds[0] else "length"
    start, turn = (
        float(np.median(getattr(pairs, f"{end}_{quantity}"))) for end in ("start", "turn")
    )
    return ReferenceCycle(
        "ramp" if kinds[0] else "stroke", start, turn, bool(np.mean(pairs.cycled) > 0.5)
    )


def leave_out(fit: HysteresisFit) -> HysteresisFit:
    """Cross-validate a fit: leave out each record, each length (of ramps) and each pressure (of strokes).

    Thresholds are chosen again from the remaining records. Groups with a single member are skipped.

    Args:
        fit: result of `fit_hysteresis`.

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
    """Return the fit as JSON-ready data in SI; `famjax.cards.slip_from_dict` reads its elements."""
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
    """Return the fit as a table of text in a unit system: title, header, rows."""
    unit, measured = unit_system(system)["force"], fit.pairs.measured_rms

    def row(name: str, value: float) -> tuple[str, str, str]:
        share = f"{100 * value / measured:.3g} %" if measured > 0 else "none"
        return name, f"{from_si(value, unit, 'force'):.4g}", share

    lost = [1e3 * fit.heat(k) for k in np.unique(fit.pairs.record).tolist()]
    rows = [
        row("measured", measured),
        row("error of the fit", fit.rms),
        *(row(f"held-out error, one {one.groups} left out", one.rms) for one in fit.left_out),
        ("elements with a strength", str((_strengths(fit) > 0).sum()), ""),
        ("energy lost per cycle, mJ", f"{min(lost):.3g} to {max(lost):.3g}", ""),
        ("KKT residual", f"{fit.kkt_residual:.1e}", ""),
        ("duality gap", f"{fit.duality_gap:.1e}", ""),
    ]
    title = f"Hysteresis: half-difference of the branches, RMS over {fit.pairs.record.size} points"
    return title, ("", unit, "of measured"), rows


def _strengths(fit: HysteresisFit) -> np.ndarray:
    sides = (fit.slip.wall, fit.slip.braid)
    return np.concatenate([np.asarray(one.strength, float) for one in sides])


def hysteresis_warnings(fit: HysteresisFit) -> tuple[str, ...]:
    """Return warnings about the reliability of the hysteresis."""
    found = []
    if not (_strengths(fit) > 0).any():
        found.append(
            "No element of the hysteresis has a strength: the branches are interchanged, or all are at "
            "the rest length, where the model has no loop."
        )
    found += [
        f"The hysteresis does not predict a held-out {one.groups}: its error is {one.ratio:.0%} of the "
        "measured half-difference."
        for one in fit.left_out
        if not one.ratio <= PREDICTS
    ]
    if not fit.left_out:
        found.append("The hysteresis could not be cross-validated: there is only one record.")
    return tuple(found)
