"""Compute the force of a muscle from a table in plain Python floats, using only this file.

The text of this file is copied into exported modules. The C source and the MATLAB functions use the same
formulas.
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from math import isnan, nan
from typing import Any

_STRAIGHT = 0.8
_STEPS = 60  # of a bisection


class TabulatedPull:
    """A muscle whose force is interpolated in a table and continued beyond it.

        H(L, P) = F(L_c, P) + F_L(L_c, P) y(L - L_c)                  L_c: L clipped to the table
        G(L, P) = H(L, P_c) + H_P(L, P_c) y(P - P_c) + S(L)           P_c: P clipped to the table
        F = taut(G)

    Inside the table, F is the bicubic Hermite interpolant of the force, its slopes and its mixed slope: C1,
    and exact at the nodes. y is a line that may bend towards a limit, S is the force of the stops, and
    taut clips at zero with a narrow blend; see `famjax.continuation.SafeMuscle`. All values are scalars
    in SI units, with gauge pressure.
    """

    def __init__(self, table: Mapping[str, Any]) -> None:
        """Create the muscle from its table.

        Args:
            table: nodes `length_m` and `pressure_Pa`, ascending; for each pair of nodes `force_N`,
                `stiffness_N_per_m`, `area_m2` and `mixed_m`, with one row per length; also `stops_m`,
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
        """Return the static force F [N], >= 0, at any length [m] and gauge pressure [Pa]."""
        return _taut(self.model(length, pressure)[0], self.slack_width)[0]

    def model_force(self, length: float, pressure: float) -> float:
        """Return the model force G [N], not clipped: it is negative where the muscle is slack."""
        return self.model(length, pressure)[0]

    def stiffness(self, length: float, pressure: float) -> float:
        """Return the axial stiffness dF/dL [N/m] at constant pressure."""
        force, stiffness, _ = self.model(length, pressure)
        return _taut(force, self.slack_width)[1] * stiffness

    def area(self, length: float, pressure: float) -> float:
        """Return dF/dP [m2] at constant length."""
        force, _, area = self.model(length, pressure)
        return _taut(force, self.slack_width)[1] * area

    def pressure(self, length: float, force: float) -> float:
        """Return the lowest gauge pressure [Pa] at which the muscle exerts a force [N].

        The result is 0 if the force at zero pressure is larger. If the force is never reached, it is the
        pressure limit, which is twice the highest pressure in the table. For a force <= 0, it is the
        highest pressure at which the muscle is slack.
        """
        if isnan(force + length):
            return nan
        found, low, high = self.force, 0.0, self.pressure_limit
        if force <= 0:
            found, force = self.model_force, 0.0
        if found(length, low) >= force:
            return low
        if found(length, high) <= force:
            return high
        for _ in range(_STEPS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if found(length, middle) < force else (low, middle)
        return 0.5 * (low + high)

    def model(self, length: float, pressure: float) -> tuple[float, float, float]:
        """Return the model force G [N], not clipped, and its slopes dG/dL [N/m] and dG/dP [m2]."""
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
        """Return force, slopes along length and pressure, and mixed slope at a state inside the table."""
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
    """Return the index and width of the cell that contains a value, and the position in it, 0 to 1."""
    k = min(bisect_right(nodes, value, 1, len(nodes) - 1) - 1, len(nodes) - 2)
    width = nodes[k + 1] - nodes[k]
    return k, width, (value - nodes[k]) / width


def _cubic(
    start: float, end: float, rate: float, end_rate: float, width: float, u: float
) -> tuple[float, float]:
    """Return value and slope of the cubic with the given values and slopes at the ends of a cell."""
    rise, p, q = end - start, width * rate, width * end_rate
    square, cube = 3 * rise - 2 * p - q, p + q - 2 * rise
    value = start + u * (p + u * (square + u * cube))
    return value, (p + u * (2 * square + 3 * u * cube)) / width


def _bent(step: float, ends: Sequence[float]) -> tuple[float, float]:
    """Return a step that bends towards a limit, and its slope; `ends` are 1/limit below and above."""
    inverse = ends[0] if step < 0 else ends[1]
    way = inverse * abs(step)
    if not way > _STRAIGHT:
        return step, 1.0
    t = (way - _STRAIGHT) / (1 - _STRAIGHT)
    reached = (_STRAIGHT + (1 - _STRAIGHT) * t / (1 + t)) / inverse
    return (-reached if step < 0 else reached), 1 / ((1 + t) * (1 + t))


def _taut(force: float, width: float) -> tuple[float, float]:
    """Return the force clipped at zero, with a cubic blend up to a width, and its slope."""
    if force <= 0:
        return 0.0, 0.0
    if force < width:
        t = force / width
        return force * t * (2 - t), t * (4 - 3 * t)
    return force, 1.0
