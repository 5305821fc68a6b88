"""The modulus of threads in the muscle, from its diameters while it is held at its resting length."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError

from .record import Column, check_positive, checked_columns


@dataclasses.dataclass(frozen=True)
class ModulusFit:
    """A line through stress against strain.

    Attributes:
        modulus: its slope E_b [Pa].
        modulus_stderr: [Pa]; infinite where the points are as many as the numbers fitted.
        intercept: stress [Pa] at zero strain; zero where the line is constrained through the origin.
        intercept_stderr: [Pa]; zero where the line is constrained through the origin.
        count: points fitted.
    """

    modulus: float
    modulus_stderr: float
    intercept: float
    intercept_stderr: float
    count: int


@dataclasses.dataclass(frozen=True)
class InSitu:
    """State of the threads at each reading, and the moduli that follow.

    Attributes:
        thread_length: B [m], shape (n,).
        braid_angle: theta [rad], from the circumference, shape (n,).
        strain: B / B0 - 1 [-], shape (n,).
        tension: T [N] of one thread, shape (n,).
        stress: T / A_b [Pa], shape (n,).
        rest_thread_length: B0 [m].
        linear: line through all points.
        proportional: line through all points and the origin, the law of `LinearThread`. An error
            of B0 enters it whole: all strains shift alike. The slopes of the others do not notice.
        high_pressure: line through the points at high pressure, beyond the toe region.
    """

    thread_length: Column
    braid_angle: Column
    strain: Column
    tension: Column
    stress: Column
    rest_thread_length: float
    linear: ModulusFit
    proportional: ModulusFit
    high_pressure: ModulusFit


def thread_in_situ(
    diameter: ArrayLike,
    force: ArrayLike,
    pressure: ArrayLike,
    *,
    length: float,
    turns: float,
    n_threads: int,
    area: float,
    rest_thread_length: float | None = None,
    high_pressure: float | None = None,
) -> InSitu:
    """Strain, stress and modulus of the threads while they hold a muscle at its resting length.

    B = sqrt(L^2 + (pi N D)^2),  T = (F + P pi R^2) / (n sin(theta)),  sin(theta) = L / B

    The ends, where the muscle is narrower than its diameter, are neglected.

    Args:
        diameter: braid diameter D [m] at each reading, shape (n,), > 0.
        force: pull F [N], shape (n,).
        pressure: gauge pressure P [Pa], shape (n,), >= 0.
        length: active length L [m], the same at every reading.
        turns: N [-].
        n_threads: n [-], threads of both families.
        area: A_b [m2], section of the fibres of one thread.
        rest_thread_length: B0 [m]; if None, the mean of B at the readings with P = 0.
        high_pressure: least pressure [Pa] of the high-pressure line; if None, half the largest.

    Returns:
        The states and the moduli, each with its standard error.

    Raises:
        InputError: what is wrong with the readings.

    References:
        Chambers 2021, section 5.1.
    """
    readings = {"diameter": diameter, "force": force, "pressure": pressure}
    D, F, P = checked_columns(readings, least=2).values()
    assert D is not None
    assert F is not None
    assert P is not None
    if D.min() <= 0 or P.min() < 0:
        raise InputError(
            f"diameters must be > 0 and gauge pressures >= 0, got {D.min():.6g} m and {P.min():.6g} "
            "Pa at the least"
        )
    check_positive(length=length, turns=turns, n_threads=n_threads, area=area)
    B = np.hypot(length, np.pi * turns * D)
    if rest_thread_length is None:
        if not (P == 0).any():
            raise InputError(
                "strain is counted from the unpressurised thread: give a reading at zero pressure, "
                "or rest_thread_length in m"
            )
        rest_thread_length = float(B[P == 0].mean())
    check_positive(rest_thread_length=rest_thread_length)
    strain = B / rest_thread_length - 1
    tension = (F + P * np.pi * D**2 / 4) * B / (n_threads * length)
    stress = tension / area
    threshold = P.max() / 2 if high_pressure is None else high_pressure
    high = threshold <= P
    slope = float(strain @ stress / (strain @ strain))
    off = stress - slope * strain
    error = float(np.sqrt(off @ off / (strain.size - 1) / (strain @ strain)))
    return InSitu(
        thread_length=B,
        braid_angle=np.arcsin(length / B),
        strain=strain,
        tension=tension,
        stress=stress,
        rest_thread_length=rest_thread_length,
        linear=_line(strain, stress, "at all pressures"),
        proportional=ModulusFit(slope, error, 0.0, 0.0, strain.size),
        high_pressure=_line(strain[high], stress[high], f"at or above {threshold:.4g} Pa"),
    )


def _line(x: Column, y: Column, where: str) -> ModulusFit:
    """The least-squares line y = E x + c."""
    if np.unique(x).size < 2:
        raise InputError(
            f"a modulus needs readings at two different strains; {where} there are "
            f"{np.unique(x).size}: give more pressures, or another high_pressure"
        )
    from scipy.stats import linregress  # noqa: PLC0415 -- SciPy's statistics take 0.5 s

    found: Any = linregress(x, y)
    slope, intercept = float(found.slope), float(found.intercept)
    if x.size == 2:  # which leave nothing to tell an error by
        return ModulusFit(slope, np.inf, intercept, np.inf, 2)
    return ModulusFit(slope, float(found.stderr), intercept, float(found.intercept_stderr), x.size)
