"""The force of a muscle from a table, in plain Python floats; only this file is needed.

Exported modules carry this file's text. The C source and the MATLAB functions are the same formulas.
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from math import isnan, nan
from typing import Any

_STRAIGHT = 0.8
_STEPS = 60
_CLOSE = 1e-15  # of the highest pressure


class TabulatedPull:
    """A muscle whose force comes from its table, continued beyond.

        H(L, P) = F(L_c, P) + F_L(L_c, P) y(L - L_c)                  L_c: L held in the table
        G(L, P) = H(L, P_c) + H_P(L, P_c) y(P - P_c) + S(L)           P_c: P held in the table
        F = taut(G)

    F in the table is the bicubic Hermite interpolant of force, slopes and mixed slope at its nodes:
    C1, and exact at them with its slopes. y is a line that may bend towards an end, S are stops,
    taut cuts at zero with a small blend: see `famjax.continuation.SafeMuscle`. SI, gauge pressure, scalars.
    """

    def __init__(self, table: Mapping[str, Any]) -> None:
        """The pull of a table.

        Args:
            table: nodes `length_m` and `pressure_Pa`, rising; for each pair the rows `force_N`,
                `stiffness_N_per_m`, `area_m2` and `mixed_m`, one for each length; `stops_m`,
                `stop_stiffness_N_per_m`, `stop_onset_m`, `length_ends_per_m`,
                `pressure_ends_per_Pa`, `slack_width_N`, `pressure_limit_Pa`.
        """
        self.lengths: Sequence[float] = table["length_m"]
        self.pressures: Sequence[float] = table["pressure_Pa"]
        names = ("force_N", "stiffness_N_per_m", "area_m2", "mixed_m")
        self.rows = [
            [*zip(*lines, strict=True)]
            for lines in zip(*(table[name] for name in names), strict=True)
        ]
        self.stops = table["stops_m"]
        self.stop = table["stop_stiffness_N_per_m"], table["stop_onset_m"]
        self.length_ends = table["length_ends_per_m"]
        self.pressure_ends = table["pressure_ends_per_Pa"]
        self.slack_width = table["slack_width_N"]
        self.pressure_limit = table["pressure_limit_Pa"]

    def force(self, length: float, pressure: float) -> float:
        """Static pull F [N], >= 0, at any length [m] and gauge pressure [Pa]."""
        return _taut(self.model(length, pressure)[0], self.slack_width)[0]

    def model_force(self, length: float, pressure: float) -> float:
        """G [N], the force of the model, not cut at zero: negative where the muscle is slack."""
        return self.model(length, pressure)[0]

    def stiffness(self, length: float, pressure: float) -> float:
        """Axial stiffness dF/dL [N/m] at constant pressure."""
        force, stiffness, _ = self.model(length, pressure)
        return _taut(force, self.slack_width)[1] * stiffness

    def area(self, length: float, pressure: float) -> float:
        """dF/dP [m2] at constant length."""
        force, _, area = self.model(length, pressure)
        return _taut(force, self.slack_width)[1] * area

    def pressure(self, length: float, force: float) -> float:
        """Lowest gauge pressure [Pa], from 0 to the limit, at which the muscle pulls with a force [N].

        0 where it pulls more without pressure; the limit, twice the highest pressure of the table,
        where it cannot pull so much. For a force <= 0 the highest pressure at which it is slack.
        """
        if isnan(force + length):
            return nan
        wanted = _untaut(force, self.slack_width)
        low, high = 0.0, self.pressure_limit
        if self.model(length, low)[0] >= wanted:
            return low
        if self.model(length, high)[0] <= wanted:
            return high
        pressure = 0.5 * high
        before = high
        for _ in range(_STEPS):  # Newton's, halving where it leaves the bracket or is slow
            found, _, area = self.model(length, pressure)
            over = found - wanted
            if over < 0:
                low = pressure
            else:
                high = pressure
            slow = 2 * abs(over) > before * area
            following = 0.5 * (low + high) if slow else pressure - over / area
            if not low <= following <= high:
                following = 0.5 * (low + high)
            before = abs(following - pressure)
            pressure = following
            if before <= _CLOSE * self.pressure_limit:
                break
        return pressure

    def model(self, length: float, pressure: float) -> tuple[float, float, float]:
        """(G [N], dG/dL [N/m], dG/dP [m2]): the model's force, not cut at zero, and its slopes."""
        held = min(max(length, self.lengths[0]), self.lengths[-1])
        at = min(max(pressure, self.pressures[0]), self.pressures[-1])
        force, stiffness, area, mixed = self._within(held, at)
        if length != held:
            step, slope = _bent(length - held, self.length_ends)
            stiffness, mixed = (stiffness, mixed) if stiffness > 0 else (0.0, 0.0)
            force, area = force + stiffness * step, area + mixed * step
            stiffness, mixed = stiffness * slope, mixed * slope
        if pressure != at:
            step, slope = _bent(pressure - at, self.pressure_ends)
            area, mixed = (area, mixed) if area > 0 else (0.0, 0.0)
            force, stiffness, area = force + area * step, stiffness + mixed * step, area * slope
        for way, sign in ((length - self.stops[1], 1.0), (self.stops[0] - length, -1.0)):
            if way > 0:
                rate, onset = self.stop
                on = min(way, onset)
                force += sign * rate * (on * on / (2 * onset) + (way - on))
                stiffness += rate * on / onset
        return force, stiffness, area

    def _within(self, length: float, pressure: float) -> tuple[float, float, float, float]:
        """Force, slopes along length and pressure, mixed slope, in the table."""
        i, h, u = _cell(self.lengths, length)
        j, g, v = _cell(self.pressures, pressure)
        (a, b), (c, d) = self.rows[i][j : j + 2], self.rows[i + 1][j : j + 2]
        low, low_slope = _cubic(a[0], c[0], a[1], c[1], h, u)
        high, high_slope = _cubic(b[0], d[0], b[1], d[1], h, u)
        area_low, mixed_low = _cubic(a[2], c[2], a[3], c[3], h, u)
        area_high, mixed_high = _cubic(b[2], d[2], b[3], d[3], h, u)
        force, area = _cubic(low, high, area_low, area_high, g, v)
        stiffness, mixed = _cubic(low_slope, high_slope, mixed_low, mixed_high, g, v)
        return force, stiffness, area, mixed


def _cell(nodes: Sequence[float], value: float) -> tuple[int, float, float]:
    """Number and width of the cell that a value lies in, and its place in it from 0 to 1."""
    k = min(bisect_right(nodes, value, 1, len(nodes) - 1) - 1, len(nodes) - 2)
    width = nodes[k + 1] - nodes[k]
    return k, width, (value - nodes[k]) / width


def _cubic(
    start: float, end: float, rate: float, end_rate: float, width: float, u: float
) -> tuple[float, float]:
    """Value and slope of the cubic with these values and slopes at the ends of a cell."""
    rise, p, q = end - start, width * rate, width * end_rate
    square, cube = 3 * rise - 2 * p - q, p + q - 2 * rise
    value = start + u * (p + u * (square + u * cube))
    return value, (p + u * (2 * square + 3 * u * cube)) / width


def _bent(step: float, ends: Sequence[float]) -> tuple[float, float]:
    """A step that bends towards an end, and its slope; the ends are 1/X below and above."""
    inverse = ends[0] if step < 0 else ends[1]
    way = inverse * abs(step)
    if not way > _STRAIGHT:
        return step, 1.0
    t = (way - _STRAIGHT) / (1 - _STRAIGHT)
    reached = (_STRAIGHT + (1 - _STRAIGHT) * t / (1 + t)) / inverse
    return (-reached if step < 0 else reached), 1 / ((1 + t) * (1 + t))


def _taut(force: float, width: float) -> tuple[float, float]:
    """A force cut at zero, with a cubic up to a width, and its slope."""
    if force <= 0:
        return 0.0, 0.0
    if force < width:
        t = force / width
        return force * t * (2 - t), t * (4 - 3 * t)
    return force, 1.0


def _untaut(force: float, width: float) -> float:
    """The force of which `_taut` makes a force."""
    if force <= 0:
        return 0.0
    if force >= width:
        return force
    part, t = force / width, 1.0
    for _ in range(_STEPS):  # 2 t^2 - t^3 = part, from the side on which it is convex
        t = min(t - (t * t * (2 - t) - part) / (t * (4 - 3 * t)), 1.0)
    return width * t
