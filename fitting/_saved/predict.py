"""Predictions of a saved fit: force at lengths and pressures, and where the force begins."""

import math
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

import famjax

from .._errors import InputError
from .fit_file import SavedFit, finite_or_none

_ONSET_REACH = 3.0  # times the highest pressure of the data: beyond, a prediction means nothing


def predict(
    fit: SavedFit,
    length: Float[np.ndarray, " lengths"],
    pressure: Float[np.ndarray, " pressures"],
    *,
    onset: bool = False,
    rest_length: float | None = None,
) -> list[dict[str, Any]]:
    """What a saved muscle does at every pair of a length and a pressure.

    Args:
        fit: from `load_fit`.
        length: active lengths of the muscle itself [m], > 0.
        pressure: gauge pressures [Pa], >= 0; none needed with `onset`.
        onset: also say at which pressure the force leaves zero at each length.
        rest_length: L0 [m] of another muscle of the same series, for `famjax.cut_to_length`; None
            for the fitted one.

    Returns:
        Rows with `length_m, pressure_Pa, force_N, slack, inside`: the force is that of the muscle
        itself, without the rig that may have given way in the fit, and not clipped; slack says
        that it is not positive, null where there is no force; inside that contraction and
        pressure lie within the fitted data.
        With `onset` rows `length_m, onset_pressure_Pa, inside` follow; null where there is none.

    Raises:
        InputError: lengths or pressures that no muscle has.
    """
    if not length.size or not (pressure.size or onset):
        raise InputError(
            "a prediction needs a length, and a pressure unless the onset is asked for"
        )
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise InputError(f"lengths must be > 0, got {length.min():.6g} m")
    if pressure.size and not (np.isfinite(pressure).all() and (pressure >= 0).all()):
        raise InputError(f"gauge pressures must be >= 0, got {pressure.min():.6g} Pa")
    readings = fit.document["data"]["readings"]
    lengths, pressures = np.array(readings["length_m"]), np.array(readings["pressure_Pa"])
    muscle, ratio = fit.muscle, 1.0
    if rest_length is not None:
        muscle, ratio = _cut(muscle, rest_length)
    known = (lengths.min() * ratio <= length) & (length <= lengths.max() * ratio)
    rows: list[dict[str, Any]] = []
    if pressure.size:
        L, P = (grid.ravel() for grid in np.meshgrid(length, pressure, indexing="ij"))
        force = np.asarray(muscle.force(L, P))
        within = (pressures.min() <= P) & (pressures.max() >= P)
        for at, gauge, pull, inside in zip(
            L, P, force, np.repeat(known, pressure.size) & within, strict=True
        ):
            rows.append(
                {
                    "length_m": float(at),
                    "pressure_Pa": float(gauge),
                    "force_N": finite_or_none(float(pull)),
                    "slack": bool(pull <= 0) if np.isfinite(pull) else None,
                    "inside": bool(inside),
                }
            )
    if onset:
        found = muscle.onset_pressure(length, _ONSET_REACH * pressures.max(), throw=False)
        for at, gauge, inside in zip(length, np.asarray(found), known, strict=True):
            rows.append(
                {
                    "length_m": float(at),
                    "onset_pressure_Pa": finite_or_none(float(gauge)),
                    "inside": bool(inside and math.isfinite(gauge) and gauge <= pressures.max()),
                }
            )
    return rows


def _cut(muscle: famjax.Muscle, rest_length: float) -> tuple[famjax.Muscle, float]:
    """Another muscle of the series, and how many times as long it is."""
    fitted = float(muscle.geometry.rest_length)
    if not (math.isfinite(rest_length) and rest_length > 0):
        raise InputError(f"the rest length must be > 0, got {rest_length:.6g} m")
    cannot = f"the fitted muscle of {fitted:.4g} m cannot be cut to {rest_length:.4g} m"
    try:
        return famjax.cut_to_length(muscle, rest_length), rest_length / fitted
    except ValueError as error:
        raise InputError(f"{cannot}: {error}") from None
    except eqx.EquinoxRuntimeError:
        raise InputError(f"{cannot}: that is shorter than its rounded ends") from None
