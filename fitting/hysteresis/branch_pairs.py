"""What hysteresis is identified from: the two branches of cycles, compared point by point."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError

_COLUMNS = ("length", "pressure", "half_difference", "start_length", "start_pressure",
            "turn_length", "turn_pressure")  # fmt: skip


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

    length: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    half_difference: Float[np.ndarray, " n"]
    start_length: Float[np.ndarray, " n"]
    start_pressure: Float[np.ndarray, " n"]
    turn_length: Float[np.ndarray, " n"]
    turn_pressure: Float[np.ndarray, " n"]
    cycled: Bool[np.ndarray, " n"]
    record: Int[np.ndarray, " n"]
    names: tuple[str, ...]
    rest_length: float

    def __post_init__(self) -> None:
        if not self.length.size:
            raise InputError(
                "hysteresis needs points at which both branches pull, and there is none: record "
                "both, filling and venting or shortening and lengthening"
            )
        for name in _COLUMNS:
            values = getattr(self, name)
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise InputError(f"{name} of point {bad[0] + 1} is {values[bad[0]]}: leave it out")
        if not (np.isfinite(self.rest_length) and self.rest_length > 0):
            raise InputError(f"rest_length must be > 0 and finite, got {self.rest_length} m")
        lengths = np.concatenate([self.length, self.start_length, self.turn_length])
        if (lengths <= 0).any():
            raise InputError(f"lengths must be > 0, got {lengths.min():.6g} m")

    @classmethod
    def ramp(
        cls,
        length: float,
        pressure: Float[np.ndarray, " n"],
        half_difference: Float[np.ndarray, " n"],
        *,
        turn_pressure: float,
        rest_length: float,
        name: str = "ramp",
    ) -> "BranchPairs":
        """Those of one record at constant length that starts vented.

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
        P = np.asarray(pressure, float)
        if P.size and (P.min() < 0 or P.max() > turn_pressure):
            raise InputError(
                f"the points of a ramp lie between 0 and the turn at {turn_pressure:.6g} Pa, got "
                f"{P.min():.6g} to {P.max():.6g} Pa"
            )
        L = np.full(P.size, float(length))
        turns = np.full(P.size, float(turn_pressure))
        half = np.asarray(half_difference, float)
        return cls(
            length=L, pressure=P, half_difference=half,
            start_length=L, start_pressure=np.zeros(P.size), turn_length=L, turn_pressure=turns,
            cycled=np.zeros(P.size, bool), record=np.zeros(P.size, int), names=(name,),
            rest_length=float(rest_length),
        )  # fmt: skip

    @classmethod
    def stroke(
        cls,
        length: Float[np.ndarray, " n"],
        pressure: Float[np.ndarray, " n"],
        half_difference: Float[np.ndarray, " n"],
        *,
        longest: float,
        shortest: float,
        rest_length: float,
        cycled: bool = True,
        name: str = "stroke",
    ) -> "BranchPairs":
        """Those of strokes at one nominal pressure, such as a `fitting.rubber.HysteresisLoop` holds.

        Args:
            length: L [m] of the points, shape (n,).
            pressure: gauge pressure [Pa], shape (n,).
            half_difference: (lengthening - shortening)/2 [N], shape (n,).
            longest: length [m] at which the stroke starts.
            shortest: length [m] at which it turns.
            rest_length: L0 [m].
            cycled: other strokes went before, as where a loop is the mean of several.
            name: of the record.

        Raises:
            InputError: no points, or one that is beyond the ends.
        """
        L, P = np.asarray(length, float), np.asarray(pressure, float)
        if L.size and (L.min() < shortest or L.max() > longest):
            raise InputError(
                f"the points of a stroke lie between its ends, {shortest:.6g} and {longest:.6g} m, "
                f"got {L.min():.6g} to {L.max():.6g} m"
            )
        half = np.asarray(half_difference, float)
        return cls(
            length=L, pressure=P, half_difference=half,
            start_length=np.full(L.size, float(longest)), start_pressure=P,
            turn_length=np.full(L.size, float(shortest)), turn_pressure=P,
            cycled=np.full(L.size, cycled), record=np.zeros(L.size, int), names=(name,),
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
        return float(np.sqrt(np.mean(self.half_difference**2)))
