"""In-situ modulus of braid threads, from diameters of a muscle held at its rest length."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError

from .record import Column, check_positive, checked_columns


@dataclasses.dataclass(frozen=True)
class ModulusFit:
    """Straight-line fit of stress against strain.

    Attributes:
        modulus: slope E_b [Pa].
        modulus_stderr: standard error of the slope [Pa]; infinite without degrees of freedom.
        intercept: stress [Pa] at zero strain; zero for a line through the origin.
        intercept_stderr: standard error of the intercept [Pa]; zero for a line through the origin.
        count: number of points.
    """

    modulus: float
    modulus_stderr: float
    intercept: float
    intercept_stderr: float
    count: int


@dataclasses.dataclass(frozen=True)
class InSitu:
    """State of the threads at each reading, and the fitted moduli.

    Attributes:
        thread_length: B [m], shape (n,).
        braid_angle: theta [rad], from the circumference, shape (n,).
        strain: B / B0 - 1 [-], shape (n,).
        tension: T [N] of one thread, shape (n,).
        stress: T / A_b [Pa], shape (n,).
        rest_thread_length: B0 [m].
        linear: line fitted to all points.
        proportional: line through the origin, the law of `LinearThread`. Unlike the other slopes, it is
            sensitive to an error of B0, which shifts all strains.
        high_pressure: line fitted to the points at high pressure, beyond the toe region.
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
    """Compute strain, stress and modulus of the threads of a muscle at its rest length.

    B = sqrt(L^2 + (pi N D)^2),  T = (F + P pi R^2) / (n sin(theta)),  sin(theta) = L / B

    The narrower ends of the muscle are neglected.

    Args:
        diameter: braid diameter D [m] at each reading, shape (n,), > 0.
        force: pull F [N], shape (n,).
        pressure: gauge pressure P [Pa], shape (n,), >= 0.
        length: active length L [m], the same at every reading.
        turns: turns N of one thread [-].
        n_threads: number of threads n of both families [-].
        area: fibre cross-section A_b of one thread [m2].
        rest_thread_length: B0 [m]; if None, the mean of B at the readings with P = 0.
        high_pressure: lowest pressure [Pa] of the high-pressure line; if None, half the largest.

    Returns:
        The states and the moduli, each with its standard error.

    Raises:
        InputError: the readings are invalid.

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
            f"diameters must be > 0 and gauge pressures >= 0, got a smallest diameter of "
            f"{D.min():.6g} m and a smallest pressure of {P.min():.6g} Pa"
        )
    check_positive(length=length, turns=turns, n_threads=n_threads, area=area)
    B = np.hypot(length, np.pi * turns * D)
    if rest_thread_length is None:
        if not (P == 0).any():
            raise InputError(
                "strain requires the unpressurised thread length: give a reading at zero pressure, or "
                "rest_thread_length in m"
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
    """Fit the line y = E x + c by least squares."""
    if np.unique(x).size < 2:
        raise InputError(
            f"a modulus requires readings at two different strains, got {np.unique(x).size} {where}: give "
            "more pressures, or another high_pressure"
        )
    from scipy.stats import linregress  # noqa: PLC0415 -- SciPy's statistics take 0.5 s

    found: Any = linregress(x, y)
    slope, intercept = float(found.slope), float(found.intercept)
    if x.size == 2:  # no degrees of freedom for an error
        return ModulusFit(slope, np.inf, intercept, np.inf, 2)
    return ModulusFit(slope, float(found.stderr), intercept, float(found.intercept_stderr), x.size)
