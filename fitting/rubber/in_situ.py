"""The thread's modulus in the muscle itself: from diameters and pulls at one length."""

import dataclasses

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError


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

    thread_length: Float[np.ndarray, " n"]
    braid_angle: Float[np.ndarray, " n"]
    strain: Float[np.ndarray, " n"]
    tension: Float[np.ndarray, " n"]
    stress: Float[np.ndarray, " n"]
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
    D, F, P = _readings(readings)
    sizes = {"length": length, "turns": turns, "n_threads": n_threads, "area": area}
    if rest_thread_length is not None:
        sizes["rest_thread_length"] = rest_thread_length
    for name, size in sizes.items():
        if not (np.isfinite(size) and size > 0):
            raise InputError(f"{name} must be a positive number, got {size}")
    B = np.hypot(length, np.pi * turns * D)
    rest = _rest(B, P) if rest_thread_length is None else rest_thread_length
    strain = B / rest - 1
    tension = (F + P * np.pi * D**2 / 4) * B / (n_threads * length)
    stress = tension / area
    threshold = P.max() / 2 if high_pressure is None else high_pressure
    high = threshold <= P
    return InSitu(
        thread_length=B,
        braid_angle=np.arcsin(length / B),
        strain=strain,
        tension=tension,
        stress=stress,
        rest_thread_length=float(rest),
        linear=_line(strain, stress, "at all pressures"),
        proportional=_proportional(strain, stress),
        high_pressure=_line(strain[high], stress[high], f"at or above {threshold:.4g} Pa"),
    )


def _readings(values: dict[str, ArrayLike]) -> list[Float[np.ndarray, " n"]]:
    arrays = {name: np.asarray(value, float) for name, value in values.items()}
    shapes = {name: array.shape for name, array in arrays.items()}
    if len(set(shapes.values())) > 1 or any(len(shape) != 1 for shape in shapes.values()):
        raise InputError(
            "diameter, force and pressure must be one-dimensional and equally long, got shapes "
            + ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        )
    for name, array in arrays.items():
        wrong = ~np.isfinite(array)
        must = "be finite"
        if name == "diameter":
            wrong, must = wrong | (array <= 0), "be > 0"
        if name == "pressure":
            wrong, must = wrong | (array < 0), "be >= 0 (gauge pressure)"
        if wrong.any():
            first = int(np.flatnonzero(wrong)[0])
            raise InputError(
                f"{name} must {must}; reading {first + 1} has {array[first]:.6g} in SI units"
            )
    return list(arrays.values())


def _rest(B: Float[np.ndarray, " n"], P: Float[np.ndarray, " n"]) -> float:
    if not (P == 0).any():
        raise InputError(
            "strain is counted from the unpressurised thread: give a reading at zero pressure, "
            "or rest_thread_length in m"
        )
    return float(B[P == 0].mean())


def _line(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], where: str) -> ModulusFit:
    """The least-squares line y = E x + c."""
    if np.unique(x).size < 2:
        raise InputError(
            f"a modulus needs readings at two different strains; {where} there are "
            f"{np.unique(x).size}: give more pressures, or another high_pressure"
        )
    away = x - x.mean()
    square = away @ away
    modulus = float(away @ y / square)
    intercept = float(y.mean() - modulus * x.mean())
    variance = _variance(y - modulus * x - intercept, 2)
    return ModulusFit(
        modulus=modulus,
        modulus_stderr=float(np.sqrt(variance / square)),
        intercept=intercept,
        intercept_stderr=float(np.sqrt(variance * (1 / x.size + x.mean() ** 2 / square))),
        count=x.size,
    )


def _proportional(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> ModulusFit:
    """The least-squares line y = E x."""
    square = x @ x
    modulus = float(x @ y / square)
    return ModulusFit(
        modulus=modulus,
        modulus_stderr=float(np.sqrt(_variance(y - modulus * x, 1) / square)),
        intercept=0.0,
        intercept_stderr=0.0,
        count=x.size,
    )


def _variance(residual: Float[np.ndarray, " n"], fitted: int) -> float:
    freedom = residual.size - fitted
    return float(residual @ residual / freedom) if freedom > 0 else np.inf
