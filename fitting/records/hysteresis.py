"""Hysteresis of ramps at constant length, fitted with Maxwell-slip elements."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

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
"""Modulus E [Pa] in the slip coordinates, similar to that of rubber; see `famjax.slip.MaxwellSlip`."""
SHRINKAGE = 1e-3
"""Weight of the sum of squared strengths, relative to the largest squared column norm."""
PREDICTS = 0.6
"""Held-out error, relative to the measured half-difference, above which a warning is given."""

_ELEMENTS = 8  # thresholds on each coordinate
_OCTAVES = 7  # between the lowest and the highest threshold
_COLUMNS = ("length", "pressure", "half_difference", "turn_pressure")

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
    """Read a history of lengths and pressures from a file.

    Args:
        path: file with columns for length, pressure and optionally time, each with its unit, as in
            `time_s,length_mm,pressure_kPa`, see `famjax.tables.read_table`. Rows are in chronological
            order.
        columns: column name of each quantity whose column cannot be recognised.

    Returns:
        The history in SI.

    Raises:
        InputError: the file is invalid; the message states the row.
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
    """Half-differences between the fill and vent branches of ramps that start from a vented muscle.

    Attributes:
        length: length L [m] of each point, shape (n,).
        pressure: gauge pressure P [Pa], shape (n,).
        half_difference: (force while venting - force while filling) / 2 [N], shape (n,).
        turn_pressure: highest gauge pressure [Pa] of the point's ramp, shape (n,).
        record: name of the point's record, shape (n,).
        rest_length: rest length L0 [m] of the muscle.
    """

    length: Column
    pressure: Column
    half_difference: Column
    turn_pressure: Column
    record: np.ndarray
    rest_length: float

    def __post_init__(self) -> None:
        if not np.size(self.length):
            raise InputError(
                "hysteresis requires points at which the muscle pulls on both branches, got none: record "
                "both filling and venting"
            )
        set_columns(self, *_COLUMNS, least=1)
        check_positive(rest_length=self.rest_length, length=float(self.length.min()))
        outside = np.flatnonzero((self.pressure < 0) | (self.pressure > self.turn_pressure))
        if outside.size:
            k = outside[0]
            raise InputError(
                f"the pressures of a ramp must be between 0 and its turning point, "
                f"{self.turn_pressure[k]:.6g} Pa, got {self.pressure[k]:.6g} Pa"
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
        """Create the branch pairs of one record at constant length that starts from a vented muscle.

        Args:
            length: constant length L [m].
            pressure: gauge pressures [Pa] of the points, shape (n,).
            half_difference: (vent - fill)/2 [N] at the points, shape (n,).
            turn_pressure: highest gauge pressure [Pa] of the record.
            rest_length: rest length L0 [m] of the muscle.
            name: name of the record.

        Raises:
            InputError: there are no points, or a point is beyond the turning point.
        """
        n = np.size(pressure)
        at, turn = (np.full(n, value, float) for value in (length, turn_pressure))
        return cls(at, pressure, half_difference, turn, np.full(n, name), float(rest_length))

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
        columns = (*_COLUMNS, "record")
        return cls(
            **{name: np.concatenate([getattr(one, name) for one in parts]) for name in columns},
            rest_length=parts[0].rest_length,
        )

    def at(self, rows: Bool[np.ndarray, " n"]) -> "BranchPairs":
        """Return the selected points."""
        kept = (*_COLUMNS, "record")
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in kept})

    @property
    def measured_rms(self) -> float:
        """Root mean square [N] of the half-differences."""
        return _rms(self.half_difference)


def _rms(values: Column) -> float:
    return float(np.sqrt(np.mean(values**2)))


def threshold_grid(pairs: BranchPairs) -> Thresholds:
    """Return eight thresholds on each coordinate, each twice the previous one.

    The highest is half the largest range of a record, since only elements with lower thresholds slide in
    both directions. It is 1 if all records are at the rest length, where no coordinate changes.
    """
    start, turn = (_coordinates(pairs, pressure) for pressure in (0.0, pairs.turn_pressure))
    ranges = [float(np.abs(b - a).max()) for a, b in zip(start, turn, strict=True)]
    factors = 2.0 ** np.linspace(-_OCTAVES, 0, _ELEMENTS)
    wall, braid = ((span / 2 or 1.0) * factors for span in ranges)
    return wall, braid


def half_difference_columns(
    pairs: BranchPairs, thresholds: Thresholds
) -> Float[np.ndarray, "n elements"]:
    """Return the half-difference [N] of each element per unit strength, in the order of thresholds."""
    pressures = 0.0, pairs.pressure, pairs.turn_pressure
    start, at, turn = (_coordinates(pairs, pressure) for pressure in pressures)
    shares = slip_shares(pairs.pressure, MODULUS)
    columns = []
    for k, delta in enumerate(thresholds):
        out, home = there_and_back([start[k], at[k], turn[k], at[k]], delta)
        columns.append(np.asarray(shares[k])[:, None] * np.asarray(home - out) / 2 / delta)
    return np.concatenate(columns, axis=1)


def _coordinates(pairs: BranchPairs, pressure: Column | float) -> tuple[Column, Column]:
    """Return the wall and braid coordinates at the points' lengths and the given pressures [Pa]."""
    wall, braid = slip_coordinates(pairs.length, pressure, pairs.rest_length, MODULUS)
    return np.asarray(wall), np.asarray(braid)


@dataclasses.dataclass(frozen=True)
class HysteresisLeftOut:
    """Errors in the half-differences predicted for held-out groups.

    Attributes:
        groups: kind of group: record or length.
        rms: root mean square error [N] of the predictions.
        ratio: ratio of `rms` to the root mean square of the measured values.
    """

    groups: str
    rms: float
    ratio: float


@dataclasses.dataclass(frozen=True)
class HysteresisFit:
    """Hysteresis identified from pairs of branches.

    Attributes:
        centred: elements, centred on the middle of the records' cycles.
        pairs: fitted data.
        strength: force [N] of each element while it slides: wall, then braid.
        rms: root mean square error [N] of the half-difference.
        kkt_residual: largest violation of the optimality conditions, relative to the data.
        duality_gap: duality gap relative to the objective.
        left_out: errors of held-out predictions; empty until `leave_out` is called.
    """

    centred: CentredSlip
    pairs: BranchPairs
    strength: Float[np.ndarray, " elements"]
    rms: float
    kkt_residual: float
    duality_gap: float
    left_out: tuple[HysteresisLeftOut, ...] = ()

    def half_difference(self, pairs: BranchPairs) -> Column:
        """Predict the half-difference [N] at other points, shape (n,)."""
        sides = (self.centred.slip.wall, self.centred.slip.braid)
        wall, braid = (np.asarray(one.threshold, float) for one in sides)
        return half_difference_columns(pairs, (wall, braid)) @ self.strength


def fit_hysteresis(pairs: BranchPairs) -> HysteresisFit:
    """Fit the non-negative strengths of slip elements to measured half-differences.

        minimise 1/2 |A S - h|^2 + 1/2 r |a|^2 |S|^2   subject to   S >= 0

    At fixed thresholds the force is linear in the strengths S, so the programme is convex and its optimum
    is global. In the second term, a is the column of A with the largest norm. This term selects among
    strengths that the records do not determine, and assigns zero strength to elements that never move.

    Raises:
        InputError: the programme has no certified optimum.
    """
    wall, braid = threshold_grid(pairs)
    columns = half_difference_columns(pairs, (wall, braid))
    n = columns.shape[1]
    size = np.sqrt(SHRINKAGE) * (float(np.linalg.norm(columns, axis=0).max()) or 1.0)
    A = np.concatenate([columns, size * np.eye(n)])
    b = np.concatenate([pairs.half_difference, np.zeros(n)])
    optimum = quick_jit(solve_qp)(A, b, np.eye(n), np.zeros(n))
    if int(optimum.status) != Status.OPTIMAL:
        raise InputError(f"hysteresis: {Status(int(optimum.status)).message}")
    strength = np.maximum(np.asarray(optimum.x), 0.0)
    strength[np.asarray(optimum.active)] = 0.0  # remove rounding at active constraints
    model = MaxwellSlip(
        SlipElements(wall, strength[: wall.size]),
        SlipElements(braid, strength[wall.size :]),
        pairs.rest_length,
        MODULUS,
    )
    cycle = ReferenceCycle("ramp", 0.0, float(np.median(pairs.turn_pressure)), cycled=False)
    return HysteresisFit(
        centred=CentredSlip(model, cycle),
        pairs=pairs,
        strength=strength,
        rms=_rms(columns @ strength - pairs.half_difference),
        kkt_residual=float(optimum.kkt_residual),
        duality_gap=float(optimum.duality_gap),
    )


def leave_out(fit: HysteresisFit) -> HysteresisFit:
    """Cross-validate a fit by leaving out each record and each length in turn; set `left_out`.

    Thresholds are chosen again from the remaining records.
    """
    pairs, found = fit.pairs, []
    for kind in ("record", "length"):
        group = getattr(pairs, kind)
        values = np.unique(group)
        if values.size > 1:
            error = np.zeros(group.size)
            for value in values:
                out = group == value
                without = fit_hysteresis(pairs.at(~out)).half_difference(pairs.at(out))
                error[out] = without - pairs.half_difference[out]
            rms = _rms(error)
            found.append(HysteresisLeftOut(kind, rms, float(np.divide(rms, pairs.measured_rms))))
    return dataclasses.replace(fit, left_out=tuple(found))


def hysteresis_as_dict(fit: HysteresisFit) -> dict[str, Any]:
    """Return the fit as JSON-ready data in SI; `famjax.cards.slip_from_dict` reads its elements."""
    return {
        **slip_as_dict(fit.centred),
        "n_points": int(fit.pairs.length.size),
        "measured_rms_N": fit.pairs.measured_rms,
        "rms_N": fit.rms,
        "left_out": {
            one.groups: {"rms_N": one.rms, "ratio": finite_or_none(one.ratio)}
            for one in fit.left_out
        },
        "kkt_residual": fit.kkt_residual,
        "duality_gap": fit.duality_gap,
    }


def hysteresis_table(
    fit: HysteresisFit, system: str
) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    """Return the fit as a text table in a unit system: title, header and rows."""
    unit, measured = unit_system(system)["force"], fit.pairs.measured_rms

    def row(name: str, value: float) -> tuple[str, str, str]:
        share = f"{100 * value / measured:.3g} %" if measured > 0 else "none"
        return name, f"{from_si(value, unit, 'force'):.4g}", share

    rows = [
        row("measured", measured),
        row("error of the fit", fit.rms),
        *(row(f"held-out error, one {one.groups} left out", one.rms) for one in fit.left_out),
        ("elements with nonzero strength", str((fit.strength > 0).sum()), ""),
    ]
    title = f"Hysteresis: half-difference of the branches, RMS over {fit.pairs.record.size} points"
    return title, ("", unit, "of measured"), rows


def hysteresis_warnings(fit: HysteresisFit) -> tuple[str, ...]:
    """Return warnings about the reliability of the hysteresis."""
    found = []
    if not (fit.strength > 0).any():
        found.append(
            "All elements of the hysteresis model have zero strength: the branches are swapped, or all "
            "records are at the rest length, where the model has no hysteresis."
        )
    found += [
        f"The hysteresis model predicts a held-out {one.groups} poorly: its error is {one.ratio:.0%} of "
        "the measured half-difference."
        for one in fit.left_out
        if not one.ratio <= PREDICTS
    ]
    if not fit.left_out:
        found.append("The hysteresis model could not be cross-validated: there is only one record.")
    return tuple(found)
