"""The thread laws fitted to a tensile test of one thread."""

import dataclasses

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError
from famjax.braids import AbstractThread, LinearThread, ToeThread

from ..covariance import covariance

LAWS = ("linear", "toe")
"""Thread laws that can be fitted."""

_LARGEST_STRAIN = 0.5
_GRID = 257
_ZOOMS = 9


@dataclasses.dataclass(frozen=True)
class ThreadFit:
    """A thread law with its errors.

    Attributes:
        thread: the fitted law.
        slack: elongation [m] at which the tension begins; zero unless it was fitted.
        stderr: standard error by parameter name, in its unit; infinite where the record does not
            determine the parameter. Readings are taken as independent, which those of a densely
            sampled record are not.
        rmse: root mean square of the residual strain [-], per degree of freedom.
        degrees_of_freedom: readings minus parameters.
    """

    thread: AbstractThread
    slack: float
    stderr: dict[str, float]
    rmse: float
    degrees_of_freedom: int


def fit_thread(
    force: ArrayLike,
    elongation: ArrayLike,
    *,
    gauge_length: float,
    area: float,
    law: str = "toe",
    slack: bool = False,
) -> ThreadFit:
    """The thread law that comes nearest to a tensile test, by least squares in the strain.

    eps = T / (A_b E_b) + e_t T / (T + T_t) is linear in 1 / E_b and e_t, so that only T_t is
    searched for, over five decades and down to rounding (variable projection). The load cell's own
    error is neglected against that of the elongation.

    Args:
        force: T [N] of one thread, shape (n,): loading only, up to where the law is to hold.
        elongation: [m] at each reading, shape (n,), from that of the unloaded thread.
        gauge_length: length [m] of the unloaded thread.
        area: A_b [m2], section of the fibres of one thread.
        law: "linear" or "toe".
        slack: fit the elongation at zero tension too. A clamped thread hangs through by an amount
            that the record does not show.

    Returns:
        The law with its standard errors.

    Raises:
        InputError: the record cannot be that of a thread, or does not support the law.

    References:
        Golub & Pereyra 1973 (variable projection).

    >>> import numpy as np
    >>> strain = np.linspace(0, 0.02, 5)
    >>> fit = fit_thread(9e3 * strain, 0.25 * strain, gauge_length=0.25, area=9e-8, law="linear")
    >>> print(f"{fit.thread.modulus:.4g}")
    1e+11
    """
    if law not in LAWS:
        raise InputError(f"law must be one of {', '.join(LAWS)}; got {law!r}")
    T, strain = _record(
        force, elongation, gauge_length, area, parameters=2 * (law == "toe") + 1 + slack
    )
    toe_tension = _search(T, strain, slack) if law == "toe" else None
    A = _columns(T, toe_tension, slack)
    size = np.linalg.norm(A, axis=0)
    coefficients = np.linalg.lstsq(A / size, strain)[0] / size
    modulus = 1 / (coefficients[0] * area)
    if toe_tension is None:
        thread: AbstractThread = LinearThread(modulus, area)
    else:
        thread = ToeThread(modulus, area, coefficients[1], toe_tension)
    jacobian, names = _jacobian(T, coefficients, area, toe_tension, slack)
    residual = A @ coefficients - strain
    p = len(names)
    errors = covariance(jacobian, residual, np.zeros((0, p)), np.zeros(p, bool)).plain_stderr
    scale = {"slack": gauge_length}
    return ThreadFit(
        thread=thread,
        slack=float(coefficients[-1] * gauge_length) if slack else 0.0,
        stderr={
            name: float(error) * scale.get(name, 1.0) if np.isfinite(error) else np.inf
            for name, error in zip(names, errors, strict=True)
        },
        rmse=float(np.sqrt(residual @ residual / (T.size - p))),
        degrees_of_freedom=T.size - p,
    )


def _record(
    force: ArrayLike, elongation: ArrayLike, gauge_length: float, area: float, parameters: int
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """(tension, strain) of a record that can be a thread's."""
    T, stretch = np.asarray(force, float), np.asarray(elongation, float)
    if T.ndim != 1 or T.shape != stretch.shape:
        raise InputError(
            "force and elongation must be one-dimensional and equally long, got shapes "
            f"{T.shape} and {stretch.shape}"
        )
    for name, value in {"gauge_length [m]": gauge_length, "area [m2]": area}.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} must be positive, got {value}")
    for name, values in {"force": T, "elongation": stretch}.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                f"{name} of reading {bad[0] + 1} is {values[bad[0]]}: remove the reading"
            )
    if T.size <= parameters:
        raise InputError(
            f"{parameters} parameters need more than {parameters} readings, got {T.size}"
        )
    if T.min() < -0.01 * T.max() or T.max() <= 0:
        raise InputError(
            "a thread pulls with force >= 0, but for noise of 1 % of the largest; the record has "
            f"{T.min():.4g} to {T.max():.4g} N: check the sign and the zero of the load cell"
        )
    strain = stretch / gauge_length
    if np.abs(strain).max() > _LARGEST_STRAIN:
        raise InputError(
            f"the elongation reaches {np.abs(strain).max():.3g} of the gauge length, and no thread "
            "does: check the units of elongation and gauge_length, both in m"
        )
    if np.polyfit(T / T.max(), strain, 1)[0] <= 0:
        raise InputError(
            "the elongation must rise with the force, and it does not: check the sign of the "
            "elongation, and that force and elongation are not exchanged"
        )
    return T, strain


def _columns(
    T: Float[np.ndarray, " n"], toe_tension: Float[np.ndarray, "grid 1"] | float | None, slack: bool
) -> Float[np.ndarray, "*grid n linear"]:
    """What the strain is linear in: [T, T / (T + T_t), 1], the last two where they are fitted."""
    columns = [T]
    if toe_tension is not None:
        columns.append(T / (T + toe_tension))
    if slack:
        columns.append(np.ones_like(T))
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _misfits(
    T: Float[np.ndarray, " n"],
    strain: Float[np.ndarray, " n"],
    toe_tensions: Float[np.ndarray, " grid"],
    slack: bool,
) -> Float[np.ndarray, " grid"]:
    """Least sum of squares at each toe tension, all at once; inf where E_b or e_t is not positive."""
    A = _columns(T, toe_tensions[:, None], slack)
    left, sizes, right = np.linalg.svd(
        A / np.linalg.norm(A, axis=1, keepdims=True), full_matrices=False
    )
    kept = sizes > T.size * np.finfo(float).eps * sizes[:, :1]  # the others are rounding
    parts = np.where(kept, strain @ left, 0.0)
    coefficients = np.einsum("gk,gkp->gp", parts / np.where(kept, sizes, 1.0), right)
    residual = np.einsum("gnk,gk->gn", left, parts) - strain
    positive = np.all(coefficients[:, :2] > 0, axis=1)
    return np.where(positive, np.sum(residual**2, axis=1), np.inf)


def _search(T: Float[np.ndarray, " n"], strain: Float[np.ndarray, " n"], slack: bool) -> float:
    """The toe tension T_t [N] of the least misfit among laws with E_b > 0 and e_t > 0."""
    first = max(1e-3 * T.max(), -2 * T.min())
    grid = np.geomspace(first, 1e2 * T.max(), _GRID)
    ends = grid[[0, -1]]
    for _ in range(_ZOOMS):
        misfits = _misfits(T, strain, grid, slack)
        best = int(np.argmin(misfits))
        if not np.isfinite(misfits[best]) or grid[best] in ends:
            raise InputError(
                "the record shows no toe region, a compliance that falls to a limit: fit "
                'law="linear", or give a record from no tension to far beyond the toe'
            )
        grid = np.geomspace(grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)], 33)
    return float(grid[grid.size // 2])


def _jacobian(
    T: Float[np.ndarray, " n"],
    coefficients: Float[np.ndarray, " linear"],
    area: float,
    toe_tension: float | None,
    slack: bool,
) -> tuple[Float[np.ndarray, "n p"], list[str]]:
    """Derivatives of the strain in the law's own parameters, and their names."""
    modulus = 1 / (coefficients[0] * area)
    parts = {"modulus": -T / (area * modulus**2)}
    if toe_tension is not None:
        parts["toe_strain"] = T / (T + toe_tension)
        parts["toe_tension"] = -coefficients[1] * T / (T + toe_tension) ** 2
    if slack:
        parts["slack"] = np.ones_like(T)
    return np.stack(list(parts.values()), axis=1), list(parts)
