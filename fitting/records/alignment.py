"""Two clocks of one test: the machine's log laid onto the journal by the load, or by pulses."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError

from .load_match import best_lag, local_lags, refine

MAX_RATE = 0.01
"""Largest relative rate of two clocks that is believed: ten seconds in a quarter of an hour."""


@dataclasses.dataclass(frozen=True)
class Alignment:
    """How a machine's clock reads against the journal's.

    t_journal = t + offset + rate (t - reference),  t the machine's time

    Attributes:
        offset: [s], at the reference.
        rate: by which the journal's clock gains on the machine's [-].
        reference: the machine's time [s] at which the offset is best known.
        offset_error: standard error [s].
        rate_error: standard error [-]; infinite where one pulse is all there was.
        residual: root mean square of what is left: [N] by load, [s] by pulses.
        n: readings, or edges of pulses, that were used.
        method: "load" or "pulses".
    """

    offset: float
    rate: float
    reference: float
    offset_error: float
    rate_error: float
    residual: float
    n: int
    method: str

    def __str__(self) -> str:
        rate = f"{self.rate * 1e6:.1f}"
        if np.isfinite(self.rate_error):
            rate += f" +- {self.rate_error * 1e6:.1f}"
        return (
            f"clocks aligned by {self.method}: journal = log {self.offset:+.4f} s +- "
            f"{self.offset_error * 1e3:.2g} ms, rate {rate} ppm"
        )

    def journal_time(self, time: ArrayLike | float) -> np.ndarray:
        """The journal's time [s] of the machine's times [s], any shape."""
        machine = np.asarray(time, float)
        return np.asarray(machine + self.offset + self.rate * (machine - self.reference))

    def error(self, time: ArrayLike | float) -> np.ndarray:
        """Standard error [s] of `journal_time`, of the shape of the machine's times [s]."""
        away = np.abs(np.asarray(time, float) - self.reference)
        with np.errstate(invalid="ignore"):
            drift = np.where(away > 0, self.rate_error * away, 0.0)
        return np.asarray(np.hypot(self.offset_error, drift))


def align_by_load(
    journal_time: np.ndarray,
    journal_force: np.ndarray,
    log_time: np.ndarray,
    log_force: np.ndarray,
    *,
    near: tuple[float, float] | None = None,
    time_error: float = 0.0,
) -> Alignment:
    """The alignment under which the two load channels agree, gain and zero of either being free.

    Least squares of F_journal(t) - a F_log(t) - b over offset, rate, a and b. The standard errors
    hold for residuals that are correlated within a twentieth of the record, and that as much where the
    load changes as elsewhere. Neglected: a delay of either channel, which is an error of the offset.

    Args:
        journal_time: [s], rising, shape (n,).
        journal_force: [N], shape (n,).
        log_time: of the machine's clock [s], rising, shape (m,).
        log_force: [N], shape (m,), of the journal's sign.
        near: offset [s] and how far it may be off [s], where it is known roughly.
        time_error: standard deviation [s] of the journal's times, such as `ClockMap.error`; it is one
            error within 10 s and another beyond.

    Returns:
        The alignment.

    Raises:
        InputError: the loads hardly vary, do not agree, or agree at more than one offset.
    """
    journal = _series("journal", journal_time, journal_force)
    log = _series("log", log_time, log_force)
    lag = best_lag(*journal, *log, near)
    times, lags = local_lags(*journal, *log, lag)
    if times.size >= 2:
        rate, offset = np.polyfit(times - times.mean(), lags, 1)
        start = (float(offset), float(rate), float(times.mean()))
    else:
        start = (lag, 0.0, float(log[0].mean()))
    if abs(start[1]) > MAX_RATE:
        raise InputError(
            f"the clocks would differ by {start[1] * 1e6:.0f} ppm, more than {MAX_RATE * 1e6:.0f}: "
            "are journal and log of the same test?"
        )
    found = refine(*journal, *log, *start, time_error)
    return Alignment(**found, method="load")


def align_by_pulses(
    journal_pulses: np.ndarray, log_pulses: np.ndarray, *, resolution: float = 0.01
) -> Alignment:
    """The alignment under which pulses that both have recorded coincide.

    Either list may lack pulses or have some of its own. One pulse gives an offset and no rate.

    Args:
        journal_pulses: times of the edges [s], rising, shape (n,).
        log_pulses: times of the edges on the machine's clock [s], rising, shape (m,).
        resolution: standard deviation of the time of an edge [s]: half a log's interval or so.

    Returns:
        The alignment.

    Raises:
        InputError: a list is empty, or the pulses match in more than one way, or hardly at all.
    """
    journal, log = np.asarray(journal_pulses, float), np.asarray(log_pulses, float)
    if not (journal.size and log.size):
        raise InputError(
            f"no pulses to match: {journal.size} in the journal, {log.size} in the log"
        )
    for name, times in (("journal", journal), ("log", log)):
        if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
            raise InputError(f"the pulses of the {name} must be finite and rise, got {times}")
    pairs = _matched(journal, log, resolution)
    i, j = pairs.T
    reference = float(log[j].mean())
    away, lags = log[j] - reference, journal[i] - log[j]
    offset = float(lags.mean())
    if len(pairs) == 1:
        return Alignment(offset, 0.0, reference, resolution, np.inf, 0.0, 1, "pulses")
    rate = float(away @ lags / (away @ away))
    left = lags - offset - rate * away
    spread = np.sqrt(left @ left / (len(pairs) - 2)) if len(pairs) > 2 else 0.0
    spread = max(float(spread), resolution)  # a chance agreement of few pulses is no precision
    return Alignment(
        offset,
        rate,
        reference,
        spread / len(pairs) ** 0.5,
        spread / float(away @ away) ** 0.5,
        float(np.sqrt(left @ left / len(pairs))),
        len(pairs),
        "pulses",
    )


def _series(name: str, time: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    time, force = np.asarray(time, float), np.asarray(force, float)
    if time.ndim != 1 or time.shape != force.shape or time.size < 50:
        raise InputError(
            f"time and force of the {name} must be equally long, one-dimensional, and at least 50 "
            f"readings, got shapes {time.shape} and {force.shape}"
        )
    if not (np.all(np.isfinite(time)) and np.all(np.isfinite(force)) and np.all(np.diff(time) > 0)):
        raise InputError(f"time and force of the {name} must be finite, and time must rise")
    return time, force


def _matched(journal: np.ndarray, log: np.ndarray, resolution: float) -> np.ndarray:
    """Index pairs (journal, log) of the one hypothesis under which most pulses coincide."""
    found: dict[tuple[tuple[int, int], ...], float] = {}
    for i, j in np.ndindex(journal.size, log.size):
        at = journal[i] + log - log[j]
        nearest = np.abs(journal[:, None] - at).argmin(axis=0)
        apart = np.abs(journal[nearest] - at)
        near = apart <= 4 * resolution + MAX_RATE * np.abs(log - log[j])
        pairs = tuple((int(nearest[k]), int(k)) for k in np.flatnonzero(near))
        if len({a for a, _ in pairs}) == len(pairs):
            found.setdefault(pairs, float(apart[near].sum()))
    most = max(map(len, found), default=0)
    best = [pairs for pairs in found if len(pairs) == most]
    if most < min(journal.size, log.size) / 2 or len(best) != 1:
        raise InputError(
            f"{journal.size} pulses of the journal and {log.size} of the log match in {len(best)} "
            f"ways, with {most} pairs: vary the time between pulses, or align by load"
        )
    return np.array(best[0])
