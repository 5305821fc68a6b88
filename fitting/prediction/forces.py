"""Predictions of a saved fit: force at lengths and pressures, and where the force begins."""

import dataclasses
import functools
import math
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import finite_or_none

from ..arguments import check_numbers, shown
from ..evidence.disagreement import disagreement
from ..evidence.pull import Pull, pull
from ..saved.saved_fit import SavedFit
from .inside import Reach, reach_of
from .onset import measured_onset, onset_pressure
from .slack import reported, seen_slack

NORMAL_95 = 1.96
"""Standard deviations on either side that hold 95 %."""

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
        Rows with `length_m, pressure_Pa, force_N, model_force_N, slack, inside, outside`: the force
        is what the rig of the fit would measure, 0 where the muscle is slack, and the model's force
        the same not clipped, which is below zero there; slack says that the model does not pull.
        All are null where there is no force: where the model has none, beyond the limits of the
        braid, and where it gives ten times the largest measured force beyond the measured lengths.
        Inside that contraction and pressure (and rest length, in a series) lie within the fitted
        data, and outside why they do not, or why there is no force, null where they do.
        `force_std_N` is the standard deviation of a reading about the model's force, and
        `low_95_N` to `high_95_N` holds 95 % of the readings, which are never below zero: it reaches 0
        where the muscle is slack, and where a slack reading at no smaller length and no lower
        pressure says that it is. They are null where nothing is known of it: that is so of another
        rest length, unless the fit is of a series, or of a model that was chosen with nothing said of
        deadband and rig. Of such a model another muscle has the mean force of all accounts that the
        map cannot refute, see `fitting.other_lengths.OtherLengths`. `band` says what they are made of:
        "left out" (see `ModelError`), with "bootstrap" of the parameters where that was asked for, "linear"
        theory of the parameters alone in fits without it, "specimens" of a series, "one specimen" of
        another length, and "shared errors" where they were stated. Where the rig gives way,
        `muscle_force_N` is the force of the muscle alone, were it of that length itself, 0 where slack.
        With `onset` rows `length_m, onset_pressure_Pa, slack_up_to_Pa, pulls_from_Pa, inside, outside`
        follow; null where there is none. At a length that was measured the onset lies between the
        highest pressure at which the muscle was slack and the lowest at which it pulled.

    Raises:
        InputError: lengths or pressures that no muscle has.
    """
    if not isinstance(fit, SavedFit):
        raise InputError(f"a saved fit is needed, from fitting.load_fit(path), got {shown(fit)}")
    length, pressure = (
        np.atleast_1d(check_numbers(name, given))
        for name, given in (("length", length), ("pressure", pressure))
    )
    _check(length, pressure, onset, length_std)
    if rest_length is not None:
        _check_cut(fit.muscle, rest_length)
    reach = reach_of(fit, rest_length)
    rows: list[dict[str, Any]] = []
    if pressure.size:
        L, P = (grid.ravel() for grid in np.meshgrid(length, pressure, indexing="ij"))
        rows += static_rows(fit, L, P, rest_length=rest_length, length_std=length_std)
    if onset:
        highest = reach.pressures[1]
        for at in length:
            gauge = onset_pressure(
                lambda P, at=at: _pull(fit, np.full(P.shape, at), P, rest_length).muscle_force,
                _ONSET_REACH * highest,
            )
            seen = None if rest_length is not None else measured_onset(fit.document, float(at))
            if seen is not None and math.isfinite(gauge):
                gauge = min(max(gauge, seen[0]), seen[1])
            begins = max(gauge, reach.pressures[0])  # below the measured pressures it is known, too
            why = reach.leaves(float(at), begins, finite_or_none(gauge))
            rows.append(
                {
                    "length_m": float(at),
                    "onset_pressure_Pa": finite_or_none(gauge),
                    "slack_up_to_Pa": None if seen is None else seen[0],
                    "pulls_from_Pa": None if seen is None else seen[1],
                    "inside": why is None,
                    "outside": why,
                }
            )
    return rows


def static_rows(
    fit: SavedFit,
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
    *,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> list[dict[str, Any]]:
    """The rows of `predict` at pairs of lengths and pressures that have been checked."""
    found = model_forces(fit, length, pressure, rest_length=rest_length, length_std=length_std)
    known = np.isfinite(found.force)
    seen = np.zeros(length.size, bool)
    if rest_length is None:
        seen = seen_slack(fit.document, length, pressure)
    said, rows = reported(found.force, found.half, seen, found.narrowest), []
    for k, refused in enumerate(found.refused):
        error = float(found.std[k])
        row = {
            "length_m": float(length[k]),
            "pressure_Pa": float(pressure[k]),
            "force_N": finite_or_none(said.force[k]),
            "model_force_N": finite_or_none(found.force[k]),
            "force_std_N": finite_or_none(error),
            "low_95_N": finite_or_none(said.low[k]),
            "high_95_N": finite_or_none(said.high[k]),
            "band": found.band if math.isfinite(error) else None,
            "slack": bool(said.slack[k]) if known[k] else None,
        }
        if fit.document.get("series_compliance_m_per_N"):
            row["muscle_force_N"] = finite_or_none(np.maximum(found.muscle_force[k], 0.0))
        why = refused or found.reach.leaves(row["length_m"], row["pressure_Pa"], row["force_N"])
        rows.append(row | {"inside": why is None, "outside": why})
    return rows


@dataclasses.dataclass(frozen=True)
class ModelForces:
    """Forces of a saved fit, not clipped; nan where there is none.

    Attributes:
        force: what the rig of the fit would measure if the muscle could push [N].
        muscle_force: of the muscle alone, were it of that length itself [N].
        std: standard deviation of a reading about the force [N].
        half: half of the 95 % band [N].
        narrowest: half of the band where the model is known best [N]; 0 where nothing was left out.
        band: what the band is made of, None where there is none.
        reach: what the fit covers.
        refused: why nothing is said of a state of which the model has a force, see `Reach.refuses`.
    """

    force: Float[np.ndarray, " n"]
    muscle_force: Float[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]
    half: Float[np.ndarray, " n"]
    narrowest: float
    band: str | None
    reach: Reach
    refused: list[str | None]


def model_forces(
    fit: SavedFit,
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
    *,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> ModelForces:
    """What the model of a saved fit says, before a muscle that cannot push is thought of.

    Args:
        fit: from `load_fit`.
        length: active lengths [m].
        pressure: gauge pressures [Pa], one for each length.
        rest_length: as for `predict`.
        length_std: as for `predict`.
    """
    reach = reach_of(fit, rest_length)
    found = _pull(fit, length, pressure, rest_length, length_std)
    std, factor, band = _band(fit, found, length, pressure, rest_length)
    refused = [reach.refuses(*at) for at in zip(length.tolist(), found.force.tolist(), strict=True)]
    kept = np.array([why is None for why in refused])
    force, alone, std, half = (
        np.where(kept, one, np.nan) for one in (found.force, found.muscle_force, std, factor * std)
    )
    narrowest = 0.0 if fit.error is None else fit.error.narrowest
    return ModelForces(force, alone, std, half, narrowest, band, reach, refused)


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


def _pull(
    fit: SavedFit,
    length: np.ndarray,
    pressure: np.ndarray,
    rest_length: float | None,
    length_std: float = 0.0,
) -> Pull:
    """Forces in the rig and of the muscle alone, with the standard deviation by linear theory.

    Of a series they are the weighted means of its two rigs; the standard deviation is that of the first.
    Of a muscle of another length than the one that was chosen it is their own.
    """
    of = functools.partial(pull, length=length, pressure=pressure, rest_length=rest_length)
    if rest_length is not None and fit.other_lengths:
        of_each = [of(one, None, length_std=length_std) for one in fit.other_lengths]
        reading = np.nan_to_num(of_each[0].std)  # by the error of the lengths alone
        std = np.hypot(np.std([one.force for one in of_each], axis=0), reading)
        weights = None
    else:
        spread = _spread(fit)
        directions = [
            *([] if _by_what_was_left_out(fit) else spread.get("directions", [])),
            *spread.get("shared_directions", []),
        ]
        varied = np.array(directions) if directions else None
        first = of(fit.mounted, varied, length_std=length_std)
        of_each, std = [first, *(of(one, None) for one in fit.others)], first.std
        weights = fit.weights
    return Pull(
        force=np.average([one.force for one in of_each], axis=0, weights=weights),
        muscle_force=np.average([one.muscle_force for one in of_each], axis=0, weights=weights),
        std=std,
    )


def _band(
    fit: SavedFit,
    found: Pull,
    length: np.ndarray,
    pressure: np.ndarray,
    rest_length: float | None,
) -> tuple[np.ndarray, np.ndarray | float, str | None]:
    """Standard deviation of a reading, how many of them on either side are 95 %, and what it is of."""
    known, theory = np.isfinite(found.force), _spread(fit).get("band")
    std, factor, band = np.full(length.size, np.nan), NORMAL_95, None
    if "series" in fit.document:
        # Leaving a specimen out leaves the error of the parameters in.
        std = np.maximum(found.std, fit.document["series"]["between_N"])
        band = f"{theory}, specimens"
    elif rest_length is not None:
        # One specimen does not tell how specimens differ, nor its braid from its rig.
        if not fit.other_lengths:
            return std, factor, band
        std, band = np.hypot(found.std, fit.document["other_lengths"]["between_N"]), "one specimen"
    elif fit.error is not None:
        differ = disagreement(found.force, fit.alike, length, pressure)
        factor = fit.document["model_error"]["factor_95"]
        model = fit.error.half_band(length, pressure, differ) / factor
        if _by_what_was_left_out(fit):
            std, band = np.hypot(model, found.std), "left out"
            # No reading left out shows an error that all share: it is stated, and normal.
            student, normal = factor * model, NORMAL_95 * found.std
            factor = np.hypot(student, normal) / np.where(std > 0, std, 1.0)
        else:
            std, band = np.maximum(model, found.std), f"left out, {theory}"
        if _spread(fit).get("shared_directions"):
            band += ", shared errors"
    elif _spread(fit).get("directions"):
        std, band = found.std, theory
    return np.where(known, std, np.nan), factor, band


def _spread(fit: SavedFit) -> dict[str, Any]:
    return fit.document.get("spread") or {}


def _by_what_was_left_out(fit: SavedFit) -> bool:
    """Whether the band is made of errors on readings left out, those of the parameters among them."""
    return fit.error is not None and _spread(fit).get("band") != "bootstrap"


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
