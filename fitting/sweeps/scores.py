"""What the fits of a sweep are judged by: errors in force and stroke, information, stability."""

import dataclasses

import jax
import numpy as np
from jaxtyping import Float

from .design import Design
from .forms import Forms, n_coefficients
from .linear_model import LinearModel
from .readings import Readings

_AT_REST = 1e-3  # a reading is blocked whose length is the rest length to this part
_NEARLY_FREE = 0.1  # readings below this part of a pressure's largest force give its free length
_LENGTHS = 129
_BEYOND = 2.0  # lengths are looked at to this multiple of the largest measured contraction


@dataclasses.dataclass(frozen=True)
class Scores:
    """Figures of merit of every fit, with the leading axes of the fits.

    Attributes:
        rmse, mae: of each pressure [N], shape (..., pressures).
        blocked_error: model minus measured blocked force [N] of each pressure, nan where no
            reading was taken at the rest length.
        free_contraction_error: model minus measured free contraction [-] of each pressure.
        aicc, bic: information criteria of independent normal errors, shape (...).
        margin: smallest modulus along the actuation paths [Pa], >= 0 when Drucker-stable.
    """

    rmse: Float[np.ndarray, "*fits pressures"]
    mae: Float[np.ndarray, "*fits pressures"]
    blocked_error: Float[np.ndarray, "*fits pressures"]
    free_contraction_error: Float[np.ndarray, "*fits pressures"]
    aicc: Float[np.ndarray, "*fits"]
    bic: Float[np.ndarray, "*fits"]
    margin: Float[np.ndarray, "*fits"]


def measured_ends(
    readings: Readings, rest_length: float
) -> tuple[Float[np.ndarray, " pressures"], Float[np.ndarray, " pressures"]]:
    """Blocked force [N] and free contraction [-] as measured, per pressure.

    The blocked force is the mean of the readings at rest. The free contraction is where a line
    through the readings of less than a tenth of the largest force, or through those at the two
    shortest lengths, reaches zero.
    """
    blocked, free = [], []
    for force, length, there in zip(readings.force, readings.length, readings.there, strict=True):
        F, contraction = force[there], 1 - length[there] / rest_length
        at_rest = np.abs(contraction) < _AT_REST
        blocked.append(F[at_rest].mean() if at_rest.any() else np.nan)
        near = _NEARLY_FREE * F.max() >= F
        if np.unique(contraction[near]).size < 3:
            near = contraction >= np.unique(contraction)[-2:][0]
        if np.unique(F[near]).size < 2:
            free.append(np.nan)
            continue
        slope, at_zero = np.polyfit(F[near], contraction[near], 1)
        free.append(at_zero if slope < 0 else np.nan)
    return np.array(blocked), np.array(free)


def score(
    of: Design,
    model: LinearModel,
    readings: Readings,
    coefficients: Float[np.ndarray, "dependences orders constraints pressures order"],
    forms: Forms,
) -> Scores:
    """The scores of all fits, by their coefficients E_n [Pa]."""
    blocked, free = measured_ends(readings, model.rest_length)
    there, count = of.there, of.there.sum(axis=1)
    residual = (of.A @ (coefficients / of.unit)[..., None])[..., 0] - of.target
    residual = np.where(there, residual, 0.0)
    contraction = _contractions(model, readings)
    braid, bladder = model.columns(
        model.rest_length * (1 - contraction), readings.pressure[:, None]
    )
    force = braid + (bladder @ coefficients[..., None])[..., 0]
    n = count.sum()
    k = np.array([
        [n_coefficients(d, o, count.size) + 1.0 for o in forms.orders] for d in forms.dependences
    ])[..., None]  # fmt: skip
    deviance = n * np.log(np.sum((of.weight * residual) ** 2, axis=(-2, -1)) / n)
    room = n - k - 1
    correction = np.where(room > 0, 2 * k * (k + 1) / np.where(room > 0, room, 1.0), np.inf)
    return Scores(
        rmse=np.sqrt(np.sum(residual**2, axis=-1) / count),
        mae=np.sum(np.abs(residual), axis=-1) / count,
        blocked_error=force[..., 0] - blocked,
        free_contraction_error=_first_zero(contraction, force) - free,
        aicc=deviance + 2 * k + correction,
        bic=deviance + k * np.log(n),
        margin=_margins(of, coefficients / of.unit),
    )


def _margins(
    of: Design, coefficients: Float[np.ndarray, "*fits paths order"]
) -> Float[np.ndarray, "*fits"]:
    """Smallest modulus along the paths [Pa] of scaled coefficients."""
    count = coefficients.shape[-2]
    paths = np.arange(count, 2 * count)
    table = jax.tree.map(lambda leaf: leaf[paths], of.table)
    least, s, _ = table.minima(coefficients)
    at = np.take_along_axis(s, least.argmin(axis=-1)[..., None], axis=-1)[..., 0]
    phi = of.functions.rows(np.broadcast_to(paths, at.shape), at)[0]
    return np.sum(phi * coefficients, axis=-1).min(axis=-1)


def _contractions(model: LinearModel, readings: Readings) -> Float[np.ndarray, " lengths"]:
    """Contractions [-] from rest to beyond the measured ones, as far as the geometry goes."""
    rest = model.rest_length
    reached = _BEYOND * (1 - readings.path_end.min() / rest)
    return min(reached, 1 - model.shortest_length / rest) * np.arange(_LENGTHS) / (_LENGTHS - 1)


def _first_zero(
    x: Float[np.ndarray, " lengths"], force: Float[np.ndarray, "*fits pressures lengths"]
) -> Float[np.ndarray, "*fits pressures"]:
    """Where the force first falls through zero, nan where it does not."""
    falls = (force[..., :-1] > 0) & (force[..., 1:] <= 0)
    at = falls.argmax(axis=-1)
    before, after = (
        np.take_along_axis(force, (at + k)[..., None], axis=-1)[..., 0] for k in (0, 1)
    )
    drop = np.where(before > after, before - after, 1.0)
    return np.where(falls.any(axis=-1), x[at] + (x[at + 1] - x[at]) * before / drop, np.nan)
