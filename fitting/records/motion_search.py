"""The search for the offset of two clocks: all offsets coarsely, the best of them by least squares."""

from dataclasses import dataclass

import numpy as np

from .machine_log import MachineLog

_PICTURES, _STEPS = 500, 4000  # at most, in the coarse search, for its cost
_VALLEYS = 4  # of the coarse search that are refined
_DRIFT = 0.02  # largest, of one clock against the other; crystals keep to 1e-4
_HILL = 0.1  # of the variance, that parts two valleys


@dataclass(frozen=True)
class MotionFit:
    """Lengths a + sense x(t + offset + drift (t - mean t)) with the squares that they leave."""

    squares: float
    offset: float
    drift: float
    length_at_zero: float
    sense: int


def search(offsets: np.ndarray, t: np.ndarray, y: np.ndarray, log: MachineLog) -> list[MotionFit]:
    """The best fits, each of a valley of its own, the best first.

    Args:
        offsets: to try [s], rising.
        t: times of the pictures [s].
        y: lengths [m].
        log: of the machine.
    """
    scores = {sense: _scores(offsets, t, y, log, sense) for sense in (-1, 1)}
    starts = [
        (float(scores[sense][k]), float(offsets[k]), sense)
        for sense in scores
        for k in _minima(scores[sense], variation(y))
    ]
    fits = [_refined(start, sense, t, y, log) for _, start, sense in sorted(starts)[:_VALLEYS]]
    near = [fit for fit in fits if offsets[0] <= fit.offset <= offsets[-1]]
    return sorted(near or fits, key=lambda fit: fit.squares)


def grid(low: float, high: float, t: np.ndarray) -> np.ndarray:
    """Offsets a quarter of the spacing of the pictures apart, where those are not too many."""
    spacing = max(np.ptp(t) / (len(t) - 1) / 4, (high - low) / _STEPS, 1e-6)
    return np.linspace(low, high, max(3, int(np.ceil((high - low) / spacing)) + 1))


def variation(y: np.ndarray) -> float:
    """Sum of squares about the mean."""
    return float(np.sum((y - y.mean()) ** 2))


def known(at: np.ndarray, log: MachineLog) -> np.ndarray:
    """At which times it is known where the machine was: in the log, or outside where it stood still.

    It stands still before or after the log if it does over the first or the last hundredth of it.
    """
    first, last = log.time[0], log.time[-1]
    little = 0.01 * (last - first)
    ends = np.interp([first, first + little, last - little, last], log.time, log.displacement)
    before, after = np.abs(np.diff(ends)[[0, 2]]) <= 1e-3 * np.ptp(log.displacement)
    return (at >= (-np.inf if before else first)) & (at <= (np.inf if after else last))


def _scores(
    offsets: np.ndarray, t: np.ndarray, y: np.ndarray, log: MachineLog, sense: int
) -> np.ndarray:
    """Squares that each offset leaves, with the best a for each."""
    few = np.unique(np.linspace(0, len(t) - 1, min(len(t), _PICTURES)).round().astype(int))
    at = offsets[:, None] + t[few]
    covered = known(at, log)
    residual = y[few] - sense * np.interp(at, log.time, log.displacement)
    number = np.maximum(covered.sum(1, keepdims=True), 1)
    residual -= (residual * covered).sum(1, keepdims=True) / number
    plain = np.broadcast_to(y[few] - y.mean(), residual.shape)
    return _squares(residual, plain, covered).sum(1) * len(t) / len(few)


def _squares(residual: np.ndarray, plain: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Squares of the residuals; a picture outside the log counts as not explained at all."""
    return np.where(covered, residual**2, plain**2)


def _minima(scores: np.ndarray, total: float) -> list[int]:
    """The lowest points of the deepest valleys."""
    padded = np.pad(scores, 1, constant_values=np.inf)
    low = np.flatnonzero((scores <= padded[:-2]) & (scores <= padded[2:]))
    chosen: list[int] = []
    for k in low[np.argsort(scores[low])]:
        hills = [scores[min(k, c) : max(k, c) + 1].max() for c in chosen]
        if all(hill > scores[k] + _HILL * total for hill in hills):
            chosen.append(int(k))
        if len(chosen) == _VALLEYS:
            break
    return chosen


def _refined(start: float, sense: int, t: np.ndarray, y: np.ndarray, log: MachineLog) -> MotionFit:
    """Least squares over offset, drift and a, from a coarse offset."""
    from scipy.optimize import least_squares  # noqa: PLC0415 -- 0.2 s

    lever = t - t.mean()
    size = np.sqrt(variation(y) / len(y))

    def residual(p: np.ndarray, used: np.ndarray) -> np.ndarray:
        at = t + p[0] + p[1] * lever
        return (p[2] * size + sense * np.interp(at, log.time, log.displacement) - y) * used / size

    p = np.array([start, 0.0, 0.0])
    p[2] = -residual(p, known(t + start, log)).mean() * len(t) / max(known(t + start, log).sum(), 1)
    for _ in range(2):  # which pictures the log covers depends on the offset
        covered = known(t + p[0] + p[1] * lever, log)
        scale = [1.0, 1 / np.ptp(t), 1.0]
        bounds = [-np.inf, -_DRIFT, -np.inf], [np.inf, _DRIFT, np.inf]
        p = least_squares(
            residual, p, x_scale=scale, jac="3-point", bounds=bounds, args=(covered,)
        ).x
    left = residual(p, np.ones_like(t)) * size
    squares = _squares(left, y - y.mean(), known(t + p[0] + p[1] * lever, log)).sum()
    return MotionFit(float(squares), float(p[0]), float(p[1]), float(p[2] * size), sense)
