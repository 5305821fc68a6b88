"""Predictions of a saved fit: force at lengths and pressures, and where the force begins."""

import dataclasses
import math
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

import famjax
from famjax.boundary.errors import InputError

from ..evidence.pull import Pull, pull
from .onset import onset_pressure
from .saved_fit import SavedFit, finite_or_none

_NORMAL_95 = 1.96  # standard deviations on either side
_ONSET_REACH = 3.0  # times the highest pressure of the data: beyond, a prediction means nothing


def predict(
    fit: SavedFit,
    length: Float[np.ndarray, " lengths"],
    pressure: Float[np.ndarray, " pressures"],
    *,
    onset: bool = False,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> list[dict[str, Any]]:
    """What a saved muscle does at every pair of a length and a pressure.

    Args:
        fit: from `load_fit`.
        length: active lengths [m] as the rig of the fit measures them, > 0.
        pressure: gauge pressures [Pa], >= 0; none needed with `onset`.
        onset: also say at which pressure the force leaves zero at each length.
        rest_length: L0 [m] of another muscle of the same series, for `famjax.cut_to_length`; None
            for the fitted one.
        length_std: standard deviation of the lengths [m], for the error band.

    Returns:
        Rows with `length_m, pressure_Pa, force_N, slack, inside`: the force is what the rig of the
        fit would measure, not clipped; slack says that it is not positive, null where there is no
        force; inside that contraction and pressure (and rest length, in a series) lie within the
        fitted data. `force_std_N` is the standard deviation of the model's force, `low_95_N` and
        `high_95_N` 1.96 of it on either side, null where the parameters have no standard errors;
        a single reading scatters about it besides. `band` says what they are made of: "linear"
        theory or "bootstrap", and "specimens" of a series. Where the rig gives way, `muscle_force_N`
        is the force of the muscle alone, were it of that length itself.
        With `onset` rows `length_m, onset_pressure_Pa, inside` follow; null where there is none.

    Raises:
        InputError: lengths or pressures that no muscle has.
    """
    _check(length, pressure, onset, length_std)
    if rest_length is not None:
        _check_cut(fit.muscle, rest_length)
    reach = _reach(fit, rest_length)
    rows: list[dict[str, Any]] = []
    known = reach.knows_length(length)
    if pressure.size:
        L, P = (grid.ravel() for grid in np.meshgrid(length, pressure, indexing="ij"))
        within = (
            np.repeat(known, pressure.size) & (reach.pressures[0] <= P) & (reach.pressures[1] >= P)
        )
        rows += [
            row | {"inside": bool(inside)}
            for row, inside in zip(_rows(fit, L, P, rest_length, length_std), within, strict=True)
        ]
    if onset:
        highest = reach.pressures[1]
        for at, inside in zip(length, known, strict=True):
            gauge = onset_pressure(
                lambda P, at=at: _pull(fit, np.full(P.shape, at), P, rest_length).muscle_force,
                _ONSET_REACH * highest,
            )
            rows.append(
                {
                    "length_m": float(at),
                    "onset_pressure_Pa": finite_or_none(gauge),
                    "inside": bool(inside and math.isfinite(gauge) and gauge <= highest),
                }
            )
    return rows


def _check(length: np.ndarray, pressure: np.ndarray, onset: bool, length_std: float) -> None:
    if not length.size or not (pressure.size or onset):
        raise InputError(
            "a prediction needs a length, and a pressure unless the onset is asked for"
        )
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise InputError(f"lengths must be > 0, got {length.min():.6g} m")
    if pressure.size and not (np.isfinite(pressure).all() and (pressure >= 0).all()):
        raise InputError(f"gauge pressures must be >= 0, got {pressure.min():.6g} Pa")
    if not (math.isfinite(length_std) and length_std >= 0):
        raise InputError(f"the standard deviation of a length must be >= 0, got {length_std} m")


@dataclasses.dataclass(frozen=True)
class _Reach:
    """What the fitted data cover.

    Attributes:
        rest_length: of the muscle that is asked for [m].
        ratios: lowest and highest length in parts of the rest length.
        pressures: lowest and highest gauge pressure [Pa].
        same_series: the rest length lies within those of the fit.
    """

    rest_length: float
    ratios: tuple[float, float]
    pressures: tuple[float, float]
    same_series: bool

    def knows_length(self, length: np.ndarray) -> Bool[np.ndarray, " lengths"]:
        """Whether each length is within the data."""
        ratio, rounding = length / self.rest_length, 1e-12
        low, high = self.ratios
        return (low - rounding <= ratio) & (ratio <= high + rounding) & self.same_series


def _reach(fit: SavedFit, rest_length: float | None) -> _Reach:
    readings, fitted = fit.document["data"]["readings"], float(fit.muscle.geometry.rest_length)
    series = fit.document.get("series")
    asked = fitted if rest_length is None else rest_length
    if series is not None:
        rest = series["rest_lengths_m"]
        ratios, pressures = series["length_ratios"], series["pressures_Pa"]
        same = min(rest) <= asked <= max(rest)
    else:
        lengths, pressures, same = np.array(readings["length_m"]), readings["pressure_Pa"], True
        ratios = lengths / fitted
    return _Reach(asked, (min(ratios), max(ratios)), (min(pressures), max(pressures)), same)


def _pull(
    fit: SavedFit,
    length: np.ndarray,
    pressure: np.ndarray,
    rest_length: float | None,
    length_std: float = 0.0,
) -> Pull:
    """Forces in the rig and of the muscle alone, with the standard deviation by linear theory."""
    compliance = fit.document.get("series_compliance_m_per_N") or 0.0
    directions = (fit.document.get("spread") or {}).get("directions")
    return pull(
        famjax.MountedMuscle(fit.muscle, np.asarray(compliance)),
        np.array(directions) if directions else None,
        length,
        pressure,
        rest_length=rest_length,
        length_std=length_std,
    )


def _rows(
    fit: SavedFit,
    length: np.ndarray,
    pressure: np.ndarray,
    rest_length: float | None,
    length_std: float,
) -> list[dict[str, Any]]:
    """The force at every reading, in the rig and of the muscle alone, with its error band."""
    document = fit.document
    compliance, spread = document.get("series_compliance_m_per_N"), document.get("spread")
    found = _pull(fit, length, pressure, rest_length, length_std)
    force, std, band = found.force, np.full(length.size, np.nan), None
    if spread is not None and spread["directions"]:
        std, band = found.std, spread["band"]
        if "series" in document:
            std, band = np.hypot(std, document["series"]["between_N"]), f"{band}, specimens"
    rows = []
    for k in range(force.size):
        pull, error = float(force[k]), float(std[k])
        row = {
            "length_m": float(length[k]),
            "pressure_Pa": float(pressure[k]),
            "force_N": finite_or_none(pull),
            "force_std_N": finite_or_none(error),
            "low_95_N": finite_or_none(pull - _NORMAL_95 * error),
            "high_95_N": finite_or_none(pull + _NORMAL_95 * error),
            "band": band if math.isfinite(error) else None,
            "slack": bool(pull <= 0) if math.isfinite(pull) else None,
        }
        if compliance:
            row["muscle_force_N"] = finite_or_none(float(found.muscle_force[k]))
        rows.append(row)
    return rows


def _check_cut(muscle: famjax.Muscle, rest_length: float) -> None:
    """Raise unless the muscle can be one of that rest length."""
    if not (math.isfinite(rest_length) and rest_length > 0):
        raise InputError(f"the rest length must be > 0, got {rest_length:.6g} m")
    cannot = f"a muscle of this fit cannot be cut to {rest_length:.4g} m"
    try:
        famjax.cut_to_length(muscle, rest_length)
    except ValueError as error:
        raise InputError(f"{cannot}: {error}") from None
    except eqx.EquinoxRuntimeError:
        raise InputError(f"{cannot}: that is shorter than its rounded ends") from None
