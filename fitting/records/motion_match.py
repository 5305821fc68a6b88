"""The camera's clock against the test machine's, from the motion that both have seen."""

from dataclasses import dataclass

import numpy as np

from famjax.boundary.errors import InputError

from .machine_log import MachineLog
from .motion_search import MotionFit, grid, known, search, variation

_FEWEST = 6  # pictures for three unknowns and their scatter
_EXPLAINED = 0.9  # of the variance of length: below it the two do not show the same motion
_BLUR = 0.02  # of the stroke: largest error of displacement that the error of the clock may cause
_RIVAL = 4.0  # another offset whose squares are less than this many times the best is as good


class SyncError(InputError):
    """Clocks that the motion cannot bring together; it names the log."""

    def __init__(self, message: str, *, path: str) -> None:
        super().__init__(f"{path}: {message}")


class OtherMotion(SyncError):  # noqa: N818 - says what was found
    """The lengths do not follow the displacement: they are of two tests, or a unit is wrong.

    Attributes:
        explained: part of the lengths' variance that the displacement explains.
    """

    def __init__(self, message: str, *, path: str, explained: float) -> None:
        super().__init__(message, path=path)
        self.explained = explained


@dataclass(frozen=True)
class Synchronisation:
    """The machine's time of pictures, log_time = t + offset + (rate - 1)(t - reference).

    Args:
        offset: of the machine's clock against the camera's, at the picture time `reference` [s].
        rate: machine seconds per camera second.
        reference: mean time of the pictures used, by the camera [s].
        covariance: of offset and rate, shape (2, 2).
        sense: of the displacement; -1 where the machine counts shortening, 1 where lengthening.
        length_at_zero: of the muscle where the machine reads zero [m].
        rms: of length minus the fitted one [m].
        largest: the largest of these in magnitude [m].
        n_pictures: number of pictures used.
    """

    offset: float
    rate: float
    reference: float
    covariance: np.ndarray
    sense: int
    length_at_zero: float
    rms: float
    largest: float
    n_pictures: int

    @property
    def offset_stderr(self) -> float:
        """Standard error of the offset [s]."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def rate_stderr(self) -> float:
        """Standard error of the rate."""
        return float(np.sqrt(self.covariance[1, 1]))

    def log_time(self, time: np.ndarray) -> np.ndarray:
        """Machine time of camera times [s]."""
        time = np.asarray(time, float)
        return time + self.offset + (self.rate - 1) * (time - self.reference)

    def log_time_stderr(self, time: np.ndarray) -> np.ndarray:
        """Standard error of the machine time [s], that of offset and rate together."""
        lever = np.stack([np.ones_like(time, float), np.asarray(time, float) - self.reference])
        return np.sqrt(np.einsum("it,ij,jt->t", lever, self.covariance, lever))


def synchronise(
    time: np.ndarray,
    length: np.ndarray,
    log: MachineLog,
    *,
    length_stderr: float = 0.0,
    window: float | None = None,
    guess: float = 0.0,
) -> Synchronisation:
    """Offset and rate of the camera's clock against the machine's, the rig taken as stiff.

    Least squares of length_i = a -+ x(t_i + offset + (rate - 1)(t_i - reference)) over offset, rate
    and a, where x is the logged displacement, held before and after the log if the machine stood
    still there; the sense that fits better is taken. All offsets at which half of the pictures (or
    half of the log) overlap are tried, and rates within 2 %. Errors are those of independent
    residuals, of their scatter or of `length_stderr` if that is larger. A rig that gives way by 1 %
    makes a triangular stroke look like a rate that is wrong by 1 %.

    Args:
        time: of the pictures by the camera's clock, shape (n,) [s]; pictures with nan are left out.
        length: measured, shape (n,) [m]; pictures with nan are left out.
        log: of the machine.
        length_stderr: standard error of a length, that part of it included that all share [m].
        window: largest distance of the offset from `guess` [s]; no limit if None.
        guess: of the offset [s], of use only with a window.

    Returns:
        The fitted clock, with its errors.

    Raises:
        SyncError: too few pictures, no overlap, no motion, motion that does not fix the offset (a
            single straight ramp), several offsets that fit equally, or lengths that do not follow
            the displacement.
    """
    time, length = np.asarray(time, float), np.asarray(length, float)
    used = np.isfinite(time) & np.isfinite(length)
    t, y = time[used], length[used]
    if len(t) < _FEWEST or np.ptp(t) == 0:
        raise SyncError(
            f"the clocks need at least {_FEWEST} measured pictures with time stamps that differ, "
            f"got {len(t)}",
            path=log.source,
        )
    if np.ptp(log.displacement) == 0 or np.ptp(y) == 0:
        still = "the machine's displacement" if np.ptp(log.displacement) == 0 else "the length"
        raise SyncError(
            f"there is no motion to align: {still} is constant; photograph a stroke with the log "
            "running",
            path=log.source,
        )
    best, *others = search(_offsets(t, log, window, guess), t, y, log)
    found = _checked(best, t, y, log, length_stderr)
    apart = max(3 * np.ptp(t) / len(t), 5 * found.offset_stderr)
    rivals = [fit.offset for fit in others
              if fit.squares < _RIVAL * best.squares and abs(fit.offset - best.offset) > apart]  # fmt: skip
    if rivals:
        listed = " and ".join(f"{offset:.4g}" for offset in [found.offset, *rivals])
        raise SyncError(
            f"several offsets fit equally well: {listed} s; the motion repeats itself. Give a log "
            "that begins and ends with the pictures, or a window about the offset",
            path=log.source,
        )
    return found


def _offsets(t: np.ndarray, log: MachineLog, window: float | None, guess: float) -> np.ndarray:
    """The offsets to try."""
    first, last = log.time[0], log.time[-1]
    half = min(last - first, np.ptp(t)) / 2
    low, high = first - t.max() + half, last - t.min() - half
    if window is not None:
        low, high = max(low, guess - window), min(high, guess + window)
    if low > high:
        raise SyncError(
            f"no offset between {guess - (window or 0):g} and {guess + (window or 0):g} s makes "
            f"half of the pictures ({t.min():g} to {t.max():g} s) overlap the log ({first:g} to "
            f"{last:g} s); widen the window",
            path=log.source,
        )
    return grid(low, high, t)


def _checked(
    fit: MotionFit, t: np.ndarray, y: np.ndarray, log: MachineLog, length_stderr: float
) -> Synchronisation:
    """The fit with its errors, if it may be trusted."""
    lever = t - t.mean()
    at = t + fit.offset + fit.drift * lever
    covered = known(at, log)
    reference = float(t.mean())
    t, y, lever, at = t[covered], y[covered], lever[covered], at[covered]
    x = np.interp(at, log.time, log.displacement)
    residual = y - fit.length_at_zero - fit.sense * x
    explained = 1 - np.sum(residual**2) / max(variation(y), np.finfo(float).tiny) if len(t) else 0.0
    if len(t) < _FEWEST or explained < _EXPLAINED:
        raise OtherMotion(
            f"the lengths do not follow the displacement: at the best offset {fit.offset:.4g} s it "
            f"explains {max(explained, 0):.0%} of their variance in {len(t)} pictures, and must "
            f"explain {_EXPLAINED:.0%} in at least {_FEWEST}. The lengths change by "
            f"{np.ptp(y) if len(y) else 0:.4g} m, the displacement by {np.ptp(log.displacement):.4g} "
            "m: is this the log of these pictures, and its unit right?",
            path=log.source,
            explained=max(float(explained), 0.0),
        )
    speed = _speed(at, t, log)
    J = fit.sense * np.stack([speed, speed * lever, np.full_like(x, fit.sense)], axis=1)
    size = np.linalg.norm(J, axis=0)
    free = np.linalg.matrix_rank(J / np.where(size > 0, size, 1), tol=1e-9) == 3
    variance = max(np.sum(residual**2) / (len(t) - 3), length_stderr**2)
    covariance = variance * np.linalg.pinv(J.T @ J) if free else np.full((3, 3), np.inf)
    _refuse_loose(float(np.sqrt(covariance[0, 0])), speed, x, log)
    return Synchronisation(
        offset=fit.offset,
        rate=1 + fit.drift,
        reference=reference,
        covariance=covariance[:2, :2],
        sense=fit.sense,
        length_at_zero=fit.length_at_zero,
        rms=float(np.sqrt(np.mean(residual**2))),
        largest=float(np.abs(residual).max()),
        n_pictures=len(t),
    )


def _speed(at: np.ndarray, t: np.ndarray, log: MachineLog) -> np.ndarray:
    """Speed of the machine at these times, over the spacing of the pictures [m/s]."""
    step = max(float(np.median(np.diff(np.sort(t)))) / 2, 1e-9)
    late, early = (np.interp(at + s, log.time, log.displacement) for s in (step, -step))
    return (late - early) / (2 * step)


def _refuse_loose(stderr: float, speed: np.ndarray, x: np.ndarray, log: MachineLog) -> None:
    fastest, stroke = np.abs(speed).max(), np.ptp(x)
    if not stderr * fastest <= _BLUR * stroke:
        raise SyncError(
            f"the motion does not fix the offset of the clocks: its standard error is {stderr:.3g} "
            f"s, at {fastest:.3g} m/s more than {_BLUR:.0%} of the stroke of {stroke:.3g} m. "
            "Photograph a turn or a stop of the machine, not a straight ramp alone",
            path=log.source,
        )
