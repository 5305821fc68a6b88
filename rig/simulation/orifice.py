"""Flow of air through an orifice by ISO 6358."""

import math

SLOW_FLOW = 0.95
"""Pressure ratio above which the ISO 6358 flow is taken as linear: its slope is infinite at 1."""


def iso_6358_flow(
    upstream: float, downstream: float, conductance: float, critical_ratio: float
) -> tuple[float, float, float]:
    """Volume flow at reference conditions through an orifice, and its two slopes, by ISO 6358.

    Args:
        upstream: p_1 [Pa], absolute, the larger.
        downstream: p_2 [Pa], absolute.
        conductance: C [m3/(s Pa)].
        critical_ratio: b [-].

    Returns:
        Q [m3/s, ANR], dQ/dp_1 and dQ/dp_2 [m3/(s Pa)].

    >>> iso_6358_flow(2e5, 1e5, 1e-8, 0.5)[0]  # choked: C p_1
    0.002
    """
    ratio = downstream / upstream
    share, slope = share_of_sonic(ratio, critical_ratio)
    flow, by_downstream = conductance * upstream * share, conductance * slope
    return flow, conductance * (share - ratio * slope), by_downstream


def share_of_sonic(ratio: float, critical_ratio: float) -> tuple[float, float]:
    """The flow over the sonic one, psi, at a pressure ratio r = p_2 / p_1 <= 1, and d psi / d r.

    >>> share_of_sonic(0.4, 0.5)
    (1.0, 0.0)
    """
    if ratio <= critical_ratio:
        return 1.0, 0.0
    width = 1.0 - critical_ratio
    if ratio < SLOW_FLOW:
        x = (ratio - critical_ratio) / width
        share = math.sqrt(1.0 - x * x)
        return share, -x / (width * share)
    x = (SLOW_FLOW - critical_ratio) / width
    slope = -math.sqrt(1.0 - x * x) / (1.0 - SLOW_FLOW)
    return slope * (ratio - 1.0), slope
