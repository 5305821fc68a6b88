"""One test at constant pressures: the machine's motion and load with the journal's pressures."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from famjax.boundary.errors import InputError

from .alignment import Alignment
from .machine_log import MachineLog

_BRIDGE = 5  # usual intervals: where the journal is silent for longer, there is no pressure


@dataclasses.dataclass(frozen=True)
class IsobaricRecord:
    """A test in SI, one row per row of the machine's log that has a pressure.

    Attributes:
        time: by the journal's clock [s], rising, shape (n,).
        length: active length L [m], shape (n,).
        force: F [N], positive when the muscle pulls, shape (n,).
        pressure: measured, gauge [Pa], shape (n,).
        set_pressure: in force at that time, gauge [Pa], nan where there was none, shape (n,).
        rest_length: L0 [m].
        notes: what was left out.
    """

    time: np.ndarray
    length: np.ndarray
    force: np.ndarray
    pressure: np.ndarray
    set_pressure: np.ndarray
    rest_length: float
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = ("time", "length", "force", "pressure", "set_pressure")
        for name in names:
            values = np.asarray(getattr(self, name), float)
            object.__setattr__(self, name, values)
            if values.ndim != 1 or values.shape != np.shape(self.time) or values.size < 2:
                raise InputError(
                    f"all columns of a record must be one-dimensional, equally long and of at least "
                    f"two rows; {name} has shape {values.shape}, time {np.shape(self.time)}"
                )
            bad = np.flatnonzero(~np.isfinite(values))
            if name != "set_pressure" and bad.size:
                raise InputError(
                    f"{name} of row {bad[0] + 1} is {values[bad[0]]}: leave the row out"
                )
        if np.any(np.diff(self.time) <= 0):
            raise InputError("the time of a record must rise")
        if np.any(self.length <= 0):
            raise InputError(
                f"active lengths must be positive, but they would be {self.length.min():.5g} to "
                f"{self.length.max():.5g} m with a rest length of {self.rest_length:.5g} m: check "
                "the unit of the displacement, its sign, and rest_length"
            )
        if not self.rest_length > 0:
            raise InputError(f"rest_length must be positive, got {self.rest_length} m")


def combine(
    log: MachineLog,
    alignment: Alignment,
    journal_time: np.ndarray,
    journal_pressure: np.ndarray,
    set_points: Sequence[tuple[float, float]],
    *,
    rest_length: float,
    shortening_positive: bool = False,
    zero_displacement: float = 0.0,
    pushing_positive: bool = False,
) -> IsobaricRecord:
    """A record of a test from the machine's log and the journal.

    L = L0 + (displacement - zero). Each row takes the journal's nearest reading of the pressure, not
    a mean, so that its scatter stays what was measured. Rows at which the journal is silent, or
    before the first set point, are left out.

    Args:
        log: of the machine.
        alignment: of its clock to the journal's.
        journal_time: [s], rising, shape (n,).
        journal_pressure: gauge [Pa], shape (n,).
        set_points: time of the journal [s] and set pressure [Pa] from then on, in order; nan ends one.
        rest_length: L0 [m].
        shortening_positive: the machine's displacement grows as the muscle shortens.
        zero_displacement: what the machine shows at L0 [m].
        pushing_positive: the machine's force is positive in compression.

    Returns:
        The record.

    Raises:
        InputError: journal and log do not overlap, or there is no set point.
    """
    journal_time = np.asarray(journal_time, float)
    journal_pressure = np.asarray(journal_pressure, float)
    if journal_time.shape != journal_pressure.shape or journal_time.size < 2:
        raise InputError(
            f"time and pressure of the journal must be equally long, got {journal_time.shape} and "
            f"{journal_pressure.shape}"
        )
    if not set_points:
        raise InputError("the journal has no set point: nothing was held at a pressure")
    time = alignment.journal_time(log.time)
    right = np.clip(np.searchsorted(journal_time, time), 1, journal_time.size - 1)
    nearest = right - (time - journal_time[right - 1] < journal_time[right] - time)
    apart = np.abs(journal_time[nearest] - time)
    heard = apart <= _BRIDGE * float(np.median(np.diff(journal_time)))
    starts = np.array([at for at, _ in set_points])
    order = np.searchsorted(starts, time, side="right") - 1
    use = heard & (order >= 0)
    if use.sum() < 2:
        raise InputError(
            "no row of the machine's log has a pressure in the journal: are they of one test?"
        )
    notes = [f"{(~heard).sum()} rows of the machine's log have no pressure in the journal."] * bool(
        (~heard).any()
    )
    if log.gaps:
        notes.append(f"The machine's log lacks {log.missing_rows} rows in {len(log.gaps)} gaps.")
    towards = -1.0 if shortening_positive else 1.0
    pressures = np.array([pressure for _, pressure in set_points], float)
    return IsobaricRecord(
        time=time[use],
        length=rest_length + towards * (log.displacement[use] - zero_displacement),
        force=(-1.0 if pushing_positive else 1.0) * log.channel("force")[use],
        pressure=journal_pressure[nearest[use]],
        set_pressure=pressures[order[use]],
        rest_length=rest_length,
        notes=tuple(notes),
    )
