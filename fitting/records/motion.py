"""Synchronise the camera's clock with the test machine's, using the motion that both recorded."""

from dataclasses import dataclass

import numpy as np

from famjax.boundary.errors import InputError

from .record import MachineLog

_FEWEST = 6  # fewest pictures, for three unknowns and their scatter
_EXPLAINED = 0.9  # smallest explained variance of the lengths in the same motion
_BLUR = 0.02  # largest displacement error due to the clock error, relative to the stroke
_RIVAL = 4.0  # ratio of squares below which another offset fits equally well
_PICTURES, _STEPS = 500, 4000  # limits of the coarse search
_VALLEYS = 4  # number of refined minima
_DRIFT = 0.02  # largest relative drift between the clocks; crystals achieve 1e-4
_HILL = 0.1  # smallest rise between two minima, relative to the variance


class SyncError(InputError):
    """The motion does not determine the clock offset; the message states which log."""


class OtherMotion(SyncError):  # noqa: N818 - says what was found
    """The lengths do not follow the displacement: they are from different tests, or a unit is wrong.

    Attributes:
        explained: fraction of the variance of the lengths that the displacement explains.
    """

    def __init__(self, message: str, explained: float) -> None:
        super().__init__(message)
        self.explained = explained


@dataclass(frozen=True)
class Synchronisation:
    """Conversion from camera time t to machine time: log_time = t + offset + (rate - 1)(t - reference).

    Args:
        offset: offset of the machine's clock from the camera's at the camera time `reference` [s].
        rate: machine seconds per camera second.
        reference: mean camera time of the pictures used [s].
        covariance: covariance of offset and rate, shape (2, 2).
        sense: sign of the displacement; -1 if shortening is positive, 1 if lengthening is.
        length_at_zero: length of the muscle at zero displacement [m].
        rms: root mean square of the length residuals [m].
        n_pictures: number of pictures used.
    """

    offset: float
    rate: float
    reference: float
    covariance: np.ndarray
    sense: int
    length_at_zero: float
    rms: float
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
        """Convert camera times [s] to machine times [s]."""
        time = np.asarray(time, float)
        return time + self.offset + (self.rate - 1) * (time - self.reference)

    def log_time_stderr(self, time: np.ndarray) -> np.ndarray:
        """Return the standard error of the machine time [s], from offset and rate together."""
        lever = np.stack([np.ones_like(time, float), np.asarray(time, float) - self.reference])
        return np.sqrt(np.einsum("it,ij,jt->t", lever, self.covariance, lever))


@dataclass(frozen=True)
class _Motion:
    """Times t [s] and lengths y [m] of pictures, and the machine's log.

    The model is y = a + sense x(t + offset + drift (t - mean t)), where x is the displacement.
    """

    t: np.ndarray
    y: np.ndarray
    log: MachineLog

    @property
    def variation(self) -> float:
        """Sum of squares of the lengths about their mean."""
        return float(np.sum((self.y - self.y.mean()) ** 2))

    def at(self, offset: float, drift: float = 0.0) -> np.ndarray:
        """Return the machine time of each picture."""
        return self.t + offset + drift * (self.t - self.t.mean())

    def moved(self, at: np.ndarray) -> np.ndarray:
        """Return the machine's displacement [m] at machine times."""
        return np.interp(at, self.log.time, self.log.displacement)

    def known(self, at: np.ndarray) -> np.ndarray:
        """Return True where the position is known: during the log, or outside it with the machine at rest.

        The machine is assumed at rest before (after) the log if it is at rest during the log's first
        (last) 1 %.
        """
        first, last = self.log.time[0], self.log.time[-1]
        little = 0.01 * (last - first)
        ends = self.moved(np.array([first, first + little, last - little, last]))
        before, after = np.abs(np.diff(ends)[[0, 2]]) <= 1e-3 * np.ptp(self.log.displacement)
        return (at >= (-np.inf if before else first)) & (at <= (np.inf if after else last))


@dataclass(frozen=True)
class _Fit:
    """Parameters of the model and the sum of squared residuals."""

    squares: float
    offset: float
    drift: float
    length_at_zero: float
    sense: int


def synchronise(
    time: np.ndarray,
    length: np.ndarray,
    log: MachineLog,
    *,
    length_stderr: float = 0.0,
    near: tuple[float, float] | None = None,
) -> Synchronisation:
    """Fit offset and rate of the machine's clock relative to the camera's, for a stiff rig.

    Fits length_i = a -+ x(t_i + offset + (rate - 1)(t_i - reference)) by least squares over offset, rate
    and a. Here x is the logged displacement, which is constant before and after the log if the machine was
    at rest. The better of the two signs is used. The search covers all offsets at which half the pictures
    (or half the log) overlap, and rates within 2 %. The standard errors assume independent residuals, whose
    standard deviation is their scatter or `length_stderr`, whichever is larger. With a rig that deflects by
    1 %, a triangular stroke looks like a rate error of 1 %.

    Args:
        time: camera times of the pictures [s], shape (n,); pictures with nan are left out.
        length: measured lengths [m], shape (n,); pictures with nan are left out.
        log: log of the machine.
        length_stderr: standard error of a length [m], including errors common to all lengths.
        near: approximate offset [s] and its largest error [s], if known.

    Returns:
        The fitted clock, with its standard errors.

    Raises:
        SyncError: there are too few pictures, no overlap or no motion; the motion does not determine the
            offset (a single straight ramp) or is consistent with several; or the lengths do not follow the
            displacement.
    """
    time, length = np.asarray(time, float), np.asarray(length, float)
    used = np.isfinite(time) & np.isfinite(length)
    seen = _Motion(time[used], length[used], log)
    t = seen.t
    if len(t) < _FEWEST or np.ptp(t) == 0:
        raise SyncError(
            f"{log.source}: synchronisation needs at least {_FEWEST} measured pictures with different time "
            f"stamps, got {len(t)}"
        )
    if np.ptp(log.displacement) == 0 or np.ptp(seen.y) == 0:
        raise SyncError(
            f"{log.source}: the clocks cannot be aligned because displacement or length is constant: "
            "photograph a stroke while the log is running"
        )
    best, *others = _search(_offsets(seen, near), seen)
    found = _checked(best, seen, length_stderr)
    apart = max(3 * np.ptp(t) / len(t), 5 * found.offset_stderr)
    rivals = [fit.offset for fit in others
              if fit.squares < _RIVAL * best.squares and abs(fit.offset - best.offset) > apart]  # fmt: skip
    if rivals:
        listed = " and ".join(f"{offset:.4g}" for offset in [found.offset, *rivals])
        raise SyncError(
            f"{log.source}: several offsets fit equally well ({listed} s), because the motion repeats "
            "itself. Use a log that begins and ends with the pictures, or specify an approximate offset"
        )
    return found


def _offsets(seen: _Motion, near: tuple[float, float] | None) -> np.ndarray:
    """Return the trial offsets, spaced by a quarter of the picture spacing if their number permits."""
    t, (first, last) = seen.t, seen.log.time[[0, -1]]
    half = min(last - first, np.ptp(t)) / 2
    low, high = first - t.max() + half, last - t.min() - half
    if near is not None:
        low, high = max(low, near[0] - near[1]), min(high, near[0] + near[1])
        if low > high:
            raise SyncError(
                f"{seen.log.source}: no offset within {near[1]:g} s of {near[0]:g} s makes half of the "
                f"pictures ({t.min():g} to {t.max():g} s) overlap the log ({first:g} to {last:g} s): "
                "correct the approximate offset"
            )
    spacing = max(np.ptp(t) / (len(t) - 1) / 4, (high - low) / _STEPS, 1e-6)
    return np.linspace(low, high, max(3, int(np.ceil((high - low) / spacing)) + 1))


def _search(offsets: np.ndarray, seen: _Motion) -> list[_Fit]:
    """Return the fits from separate minima of the coarse search, best fit first."""
    starts = []
    for sense in (-1, 1):
        scores = _scores(offsets, seen, sense)
        starts += [(scores[k], offsets[k], sense) for k in _valleys(scores, seen.variation)]
    fits = [_fitted(float(offset), sense, seen) for _, offset, sense in sorted(starts)[:_VALLEYS]]
    near = [fit for fit in fits if offsets[0] <= fit.offset <= offsets[-1]]
    return sorted(near or fits, key=lambda fit: fit.squares)


def _scores(offsets: np.ndarray, seen: _Motion, sense: int) -> np.ndarray:
    """Return the sum of squares at each offset for the best a; pictures outside the log count in full."""
    n = len(seen.t)
    few = np.unique(np.linspace(0, n - 1, min(n, _PICTURES)).round().astype(int))
    at, y = offsets[:, None] + seen.t[few], seen.y[few]
    covered = seen.known(at)
    residual = y - sense * seen.moved(at)
    number = np.maximum(covered.sum(1, keepdims=True), 1)
    residual -= (residual * covered).sum(1, keepdims=True) / number
    return np.where(covered, residual**2, (y - seen.y.mean()) ** 2).sum(1) * n / len(few)


def _valleys(scores: np.ndarray, total: float) -> list[int]:
    """Return the positions of the deepest separate minima."""
    from scipy.signal import find_peaks  # noqa: PLC0415 -- 0.2 s

    depth = np.pad(-scores, 1, constant_values=-np.inf)
    peaks = find_peaks(depth, prominence=_HILL * total)[0] - 1
    return peaks[np.argsort(scores[peaks])][:_VALLEYS].tolist()


def _fitted(start: float, sense: int, seen: _Motion) -> _Fit:
    """Refine offset, drift and a by least squares from a coarse offset."""
    from scipy.optimize import least_squares  # noqa: PLC0415 -- 0.2 s

    size = np.sqrt(seen.variation / len(seen.t))

    def residual(p: np.ndarray, used: np.ndarray) -> np.ndarray:
        return (p[2] * size + sense * seen.moved(seen.at(p[0], p[1])) - seen.y) * used / size

    p = np.array([start, 0.0, 0.0])
    covered = seen.known(seen.at(start))
    p[2] = -residual(p, covered).sum() / max(covered.sum(), 1)
    for _ in range(2):  # which pictures the log covers depends on the offset
        p = least_squares(
            residual, p, x_scale=[1.0, 1 / np.ptp(seen.t), 1.0], jac="3-point",
            bounds=([-np.inf, -_DRIFT, -np.inf], [np.inf, _DRIFT, np.inf]),
            args=(seen.known(seen.at(p[0], p[1])),),
        ).x  # fmt: skip
    left = residual(p, np.ones(len(seen.t))) * size
    covered = seen.known(seen.at(p[0], p[1]))
    squares = np.where(covered, left**2, (seen.y - seen.y.mean()) ** 2).sum()
    return _Fit(float(squares), float(p[0]), float(p[1]), float(p[2] * size), sense)


def _checked(fit: _Fit, seen: _Motion, length_stderr: float) -> Synchronisation:
    """Check a fit and return it with its standard errors."""
    log, reference = seen.log, float(seen.t.mean())
    at = seen.at(fit.offset, fit.drift)
    covered = seen.known(at)
    t, y, at = seen.t[covered], seen.y[covered], at[covered]
    lever, x = t - reference, seen.moved(at)
    residual = y - fit.length_at_zero - fit.sense * x
    total = max(float(np.sum((y - y.mean()) ** 2)), np.finfo(float).tiny) if len(t) else 1.0
    explained = 1 - float(np.sum(residual**2)) / total if len(t) else 0.0
    if len(t) < _FEWEST or explained < _EXPLAINED:
        raise OtherMotion(
            f"{log.source}: the lengths do not follow the displacement: at the best offset, "
            f"{fit.offset:.4g} s, the displacement explains {max(explained, 0):.0%} of their variance in "
            f"{len(t)} pictures, but it must explain {_EXPLAINED:.0%} in at least {_FEWEST}. The lengths "
            f"change by {np.ptp(y) if len(y) else 0:.4g} m, the displacement by "
            f"{np.ptp(log.displacement):.4g} m: check that the log belongs to these pictures, and check "
            "the unit of the displacement",
            max(explained, 0.0),
        )
    # The speed is averaged over the spacing of the pictures.
    step = max(float(np.median(np.diff(np.sort(t)))) / 2, 1e-9)
    speed = (seen.moved(at + step) - seen.moved(at - step)) / (2 * step)
    J = fit.sense * np.stack([speed, speed * lever, np.full_like(x, fit.sense)], axis=1)
    size = np.linalg.norm(J, axis=0)
    free = np.linalg.matrix_rank(J / np.where(size > 0, size, 1), tol=1e-9) == 3
    variance = max(np.sum(residual**2) / (len(t) - 3), length_stderr**2)
    covariance = variance * np.linalg.pinv(J.T @ J) if free else np.full((3, 3), np.inf)
    stderr, fastest, stroke = float(np.sqrt(covariance[0, 0])), np.abs(speed).max(), np.ptp(x)
    if not stderr * fastest <= _BLUR * stroke:
        raise SyncError(
            f"{log.source}: the motion does not determine the clock offset: its standard error is "
            f"{stderr:.3g} s, which at {fastest:.3g} m/s exceeds {_BLUR:.0%} of the {stroke:.3g} m stroke. "
            "Photograph a reversal or a stop of the machine, not just a straight ramp"
        )
    return Synchronisation(
        offset=fit.offset,
        rate=1 + fit.drift,
        reference=reference,
        covariance=covariance[:2, :2],
        sense=fit.sense,
        length_at_zero=fit.length_at_zero,
        rms=float(np.sqrt(np.mean(residual**2))),
        n_pictures=len(t),
    )
