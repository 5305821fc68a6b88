"""What each cycle of a tensile test shows: softening, permanent set, lost work."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError

from .cycles import Cycle, lost_work
from .tensile_record import TensileRecord, parabola, zero_force


@dataclasses.dataclass(frozen=True)
class TensileCycle:
    """What one cycle of a tensile test shows.

    Attributes:
        number: from 1.
        max_strain: largest engineering strain [-] on the loading branch, of the gauge length
            before the test.
        peak_stress: true stress [Pa] on the loading branch at the largest displacement that all
            cycles reach.
        peak_ratio, peak_ratio_stderr: of that stress to the first cycle's [-].
        half_ratio, half_ratio_stderr: the same at half that displacement [-], where softening
            shows most.
        permanent_set, permanent_set_stderr: displacement [m] at which unloading brings the force
            back to zero; nan where the cycle does not return to it.
        gauge_length: unloaded length [m] after the cycle.
        lost_energy: work lost in the cycle per volume of rubber [J/m3].
        rate: mean speed [m/s] of the loading branch, or None where no time is known.
    """

    number: int
    max_strain: float
    peak_stress: float
    peak_ratio: float
    peak_ratio_stderr: float
    half_ratio: float
    half_ratio_stderr: float
    permanent_set: float
    permanent_set_stderr: float
    gauge_length: float
    lost_energy: float
    rate: float | None


def tensile_cycles(record: TensileRecord, cycles: Sequence[Cycle]) -> tuple[TensileCycle, ...]:
    """What each of the cycles of a record shows."""
    d, stress = record.displacement, record.true_stress
    common = min(d[cycle.first.rows].max() for cycle in cycles)
    first: tuple[tuple[float, float], ...] | None = None
    reports = []
    for number, cycle in enumerate(cycles, 1):
        rows = cycle.first.rows
        levels = tuple(_local_value(d[rows], stress[rows], at) for at in (common, common / 2))
        first = first or levels
        peak, half = (_ratio(level, base) for level, base in zip(levels, first, strict=True))
        permanent, permanent_stderr = zero_force(record, cycle.second)
        time = None if record.time is None else np.ptp(record.time[rows])
        reports.append(
            TensileCycle(
                number=number,
                max_strain=float(d[rows].max() / record.gauge_length),
                peak_stress=levels[0][0],
                peak_ratio=peak[0],
                peak_ratio_stderr=peak[1],
                half_ratio=half[0],
                half_ratio_stderr=half[1],
                permanent_set=permanent,
                permanent_set_stderr=permanent_stderr,
                gauge_length=record.gauge_length + permanent,
                lost_energy=lost_work(d, record.force, cycle) / record.volume,
                rate=float(np.ptp(d[rows]) / time) if time else None,
            )
        )
    return tuple(reports)


def _local_value(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], at: float
) -> tuple[float, float]:
    """Value and standard error of noisy y at x, by a parabola through the readings near it."""
    count = min(max(9, x.size // 20), x.size)
    if count < 5:
        raise InputError(f"a branch has only {count} readings: record at least 5, better 100")
    near = np.argsort(np.abs(x - at), kind="stable")[:count]
    coefficients, covariance = parabola(x[near] - at, y[near])
    return float(coefficients[0]), float(np.sqrt(covariance[0, 0]))


def _ratio(value: tuple[float, float], base: tuple[float, float]) -> tuple[float, float]:
    """Ratio of two values with its standard error; the base to itself is one, without error."""
    if value is base:
        return 1.0, 0.0
    ratio = value[0] / base[0]
    return ratio, float(np.hypot(value[1], ratio * base[1]) / abs(base[0]))
