"""Predictions by a saved fit: forces with error bands, onsets, pressures, and forces along a history.

A model is smooth through zero, as roots and gradients need it. What a reading can be is not: a muscle
buckles, and does not push. Below zero it is 0 N, and so are both ends of its band.
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import Quantity, Sentence, finite_or_none
from famjax.control import Outcome, pressure_for_force

from .arguments import check_numbers, shown
from .bands import Pull, disagreement, pull
from .records.hysteresis import History
from .saved import SavedFit

NORMAL_95 = 1.96
"""Standard deviations to either side of 95 % of a normal distribution."""

_ONSET_REACH = 3.0  # times the highest pressure of the data: beyond, a prediction means nothing
_CELLS = 64
_ROUNDED = 64  # times the precision, per largest force, as in `Muscle.onset_pressure`
_SAME = 5e-4  # part of a length by which readings at it may differ from it
_ROUNDING = 1e-9  # N: what is left of a force of zero
_EXACT = 1e-9  # of a pressure: the same in another unit

_FARTHEST = 3.4
"""Times as long, of the muscles with which predictions from one specimen were tried: 83 and 281 mm."""

_MOST = 10.0
"""Times the largest measured force: a law that gives more beyond the measured lengths has left its data."""


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
        map cannot refute, see `fitting.series.OtherLengths`. `band` says what they are made of:
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
    if not length.size or not (pressure.size or onset):
        raise InputError(
            "a prediction needs a length, and a pressure unless the onset is asked for"
        )
    _check_lengths(length)
    if not (np.isfinite(pressure).all() and (pressure >= 0).all()):
        raise InputError(f"gauge pressures must be >= 0, got {pressure.min():.6g} Pa")
    if not (math.isfinite(length_std) and length_std >= 0):
        raise InputError(f"the standard deviation of a length must be >= 0, got {length_std} m")
    if rest_length is not None:
        _check_cut(fit.muscle, rest_length)
    rows: list[dict[str, Any]] = []
    if pressure.size:
        L, P = (grid.ravel() for grid in np.meshgrid(length, pressure, indexing="ij"))
        rows += static_rows(fit, L, P, rest_length=rest_length, length_std=length_std)
    if onset:
        reach = _reach_of(fit, rest_length)
        rows += [_onset_row(fit, reach, float(at), rest_length) for at in length]
    return rows


def _check_lengths(length: Float[np.ndarray, " n"]) -> None:
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise InputError(f"lengths must be > 0, got {length.min():.6g} m")


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
    seen = np.zeros(length.size, bool)
    if rest_length is None:
        seen = seen_slack(fit, length, pressure)
    said = reported(found.force, found.half, seen, found.narrowest)
    reach, rows = found.reach, []
    for k, refused in enumerate(found.refused):
        at = float(length[k]), float(pressure[k])
        row: dict[str, Any] = {"length_m": at[0], "pressure_Pa": at[1]}
        row |= _figures(said, found.force, found.std, found.band, k)
        if fit.document.get("series_compliance_m_per_N"):
            row["muscle_force_N"] = finite_or_none(np.maximum(found.muscle_force[k], 0.0))
        rows.append(row | _outside(refused or reach.leaves(*at, row["force_N"])))
    return rows


def _outside(why: str | None) -> dict[str, Any]:
    return {"inside": why is None, "outside": why}


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
    reach: "Reach"
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
    reach = _reach_of(fit, rest_length)
    found = _pull(fit, length, pressure, rest_length, length_std)
    std, factor, band = _band(fit, found, length, pressure, rest_length)
    refused = [reach.refuses(*at) for at in zip(length.tolist(), found.force.tolist(), strict=True)]
    kept = np.array([why is None for why in refused])
    force, alone, std, half = (
        np.where(kept, one, np.nan) for one in (found.force, found.muscle_force, std, factor * std)
    )
    narrowest = 0.0 if fit.error is None else fit.error.narrowest
    return ModelForces(force, alone, std, half, narrowest, band, reach, refused)


def _pull(
    fit: SavedFit,
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
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
        own = [] if _by_what_was_left_out(fit) else fit.spread.get("directions", [])
        directions = [*own, *fit.spread.get("shared_directions", [])]
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
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
    rest_length: float | None,
) -> tuple[np.ndarray, np.ndarray | float, str | None]:
    """Standard deviation of a reading, how many of them on either side are 95 %, and what it is of."""
    theory = fit.spread.get("band")
    std, factor, band = np.full(length.size, np.nan), NORMAL_95, None
    if "series" in fit.document:
        # Leaving a specimen out leaves the error of the parameters in.
        std = np.maximum(found.std, fit.document["series"]["between_N"])
        band = f"{theory}, specimens"
    elif rest_length is not None:
        # One specimen does not tell how specimens differ, nor its braid from its rig.
        if fit.other_lengths:
            std = np.hypot(found.std, fit.document["other_lengths"]["between_N"])
            band = "one specimen"
    elif fit.error is not None:
        differ = disagreement(found.force, fit.alike, length, pressure)
        factor = fit.error.factor()
        model = fit.error.half_band(length, pressure, differ) / factor
        if _by_what_was_left_out(fit):
            std, band = np.hypot(model, found.std), "left out"
            # No reading left out shows an error that all share: it is stated, and normal.
            student, normal = factor * model, NORMAL_95 * found.std
            factor = np.hypot(student, normal) / np.where(std > 0, std, 1.0)
        else:
            std, band = np.maximum(model, found.std), f"left out, {theory}"
        if fit.spread.get("shared_directions"):
            band += ", shared errors"
    elif fit.spread.get("directions"):
        std, band = found.std, theory
    return np.where(np.isfinite(found.force), std, np.nan), factor, band


def _by_what_was_left_out(fit: SavedFit) -> bool:
    """Whether the band is made of errors on readings left out, those of the parameters among them."""
    return fit.error is not None and fit.spread.get("band") != "bootstrap"


@dataclasses.dataclass(frozen=True)
class Reported:
    """Forces at the fittings, nan where the model has none.

    Attributes:
        force: [N], >= 0: that of the model, 0 where the muscle is slack.
        slack: whether the model does not pull.
        low: lower end of the 95 % band [N], >= 0; 0 wherever the muscle is or was slack.
        high: upper end [N], > 0.
    """

    force: Float[np.ndarray, " n"]
    slack: Bool[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]


def reported(
    model_force: Float[np.ndarray, " n"],
    half: Float[np.ndarray, " n"],
    seen_slack: Bool[np.ndarray, " n"],
    narrowest: float = 0.0,
) -> Reported:
    """What a reading would be by a model that may be below zero.

    Args:
        model_force: [N], not clipped.
        half: half of its 95 % band [N], nan where nothing is known of it.
        seen_slack: where a reading says that the muscle does not pull, see `seen_slack`.
        narrowest: half of the band where the model is known best [N], see `ModelError.narrowest`: by so
            much a reading may be above 0 where the model is below.
    """
    slack = model_force <= _ROUNDING
    low = np.where(slack | seen_slack, np.minimum(model_force - half, 0.0), model_force - half)
    return Reported(
        force=np.where(slack, 0.0, model_force),
        slack=slack,
        low=np.maximum(low, 0.0),
        high=np.maximum(model_force + half, narrowest),
    )


def _figures(
    said: Reported,
    model: Float[np.ndarray, " n"],
    std: Float[np.ndarray, " n"],
    band: str | None,
    k: int,
) -> dict[str, Any]:
    """What a row says of a force."""
    return {
        "force_N": finite_or_none(said.force[k]),
        "model_force_N": finite_or_none(model[k]),
        "force_std_N": finite_or_none(std[k]),
        "low_95_N": finite_or_none(said.low[k]),
        "high_95_N": finite_or_none(said.high[k]),
        "band": band if np.isfinite(std[k]) else None,
        "slack": bool(said.slack[k]) if np.isfinite(model[k]) else None,
    }


def seen_slack(
    fit: SavedFit, length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Where a reading says that the muscle does not pull.

    A muscle that was slack is so, too, when it is shorter and under less pressure. A reading that is
    contradicted, by a pull at no greater length and no higher pressure, says nothing.

    Args:
        fit: with its readings.
        length: active lengths [m] of the muscle that was measured.
        pressure: gauge pressures [Pa].
    """
    L, P, force = fit.readings
    pulls, slack = force > 0, force <= 0
    contradicted = ((L[pulls] <= L[slack, None]) & (P[pulls] <= P[slack, None])).any(axis=1)
    L, P = L[slack][~contradicted], P[slack][~contradicted]
    within = (length[:, None] <= (1 + _SAME) * L) & (pressure[:, None] <= (1 + _EXACT) * P)
    return np.asarray(within.any(axis=1))


def _onset_row(
    fit: SavedFit, reach: "Reach", length: float, rest_length: float | None
) -> dict[str, Any]:
    """The pressure at which the muscle begins to pull, between the readings where it was measured."""

    def force(pressure: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return _pull(fit, np.full(pressure.shape, length), pressure, rest_length).muscle_force

    gauge = onset_pressure(force, _ONSET_REACH * reach.pressures[1])
    low, high = (None, None) if rest_length is not None else _measured_onset(fit, length)
    if low is not None and high is not None and math.isfinite(gauge):
        gauge = min(max(gauge, low), high)
    begins = max(gauge, reach.pressures[0])  # below the measured pressures it is known, too
    return {
        "length_m": length,
        "onset_pressure_Pa": finite_or_none(gauge),
        "slack_up_to_Pa": low,
        "pulls_from_Pa": high,
        **_outside(reach.leaves(length, begins, finite_or_none(gauge))),
    }


def onset_pressure(
    force: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]], highest: float
) -> float:
    """`famjax.Muscle.onset_pressure` at one length, from forces that are computed elsewhere.

    The range is walked from its upper end in 64 steps to the first one in which the force falls
    through zero, and that step again in 64, to the last digit. Nothing has to be compiled.

    Args:
        force: F(P) [N] at gauge pressures [Pa] at a held length, 65 at a time.
        highest: pressure [Pa] up to which the onset is looked for.

    Returns:
        P [Pa]; nan where the force does not fall through zero.
    """
    upper, lower, rounding = highest, 0.0, np.nan
    while True:
        grid = np.linspace(upper, lower, _CELLS + 1)
        pull = force(grid)
        if np.isnan(rounding):
            known = np.abs(pull[np.isfinite(pull)])
            rounding = _ROUNDED * np.finfo(float).eps * known.max(initial=0.0)
        if grid[-1] == 0 and abs(pull[-1]) <= rounding:  # at rest without deadband
            pull[-1] = 0.0
        falls = np.flatnonzero((pull[:-1] > 0) & (pull[1:] <= 0))
        if not falls.size:
            return np.nan
        upper, lower = grid[falls[0]], grid[falls[0] + 1]
        if upper - lower <= 4 * np.finfo(float).eps * highest:
            return float(lower)


def _measured_onset(fit: SavedFit, length: float) -> tuple[float, float] | tuple[None, None]:
    """The pressures between which a muscle of that length was seen to begin to pull.

    Returns:
        (highest pressure [Pa] at which it was slack, 0 where it never was; lowest at which it
        pulled); None at a length that was not measured, or where readings contradict one another.
    """
    at, pressure, force = fit.readings
    here = np.abs(at - length) <= _SAME * length
    pulls = here & (force > 0)
    if not pulls.any():
        return None, None
    low = float(pressure[here & (force <= 0)].max(initial=0.0))
    high = float(pressure[pulls].min())
    return (low, high) if low <= high else (None, None)


@dataclasses.dataclass(frozen=True)
class Reach:
    """What the fitted data cover.

    Attributes:
        lengths: shortest and longest active length [m], of the muscle that is asked for.
        pressures: lowest and highest gauge pressure [Pa].
        rest_length: of the muscle that is asked for [m].
        rest_lengths: shortest and longest of the specimens of the fit [m]; of one specimen, those
            that are not too far from its own.
        whose: what they are, in words.
        lock: active length [m] at the neutral angle, nan without a braid.
        thread_length: active length [m] at which the unloaded threads are straight, likewise.
        closed: active length [m] at which the braid closes the bladder's bore: the longest.
        largest_force: measured [N].
    """

    lengths: tuple[float, float]
    pressures: tuple[float, float]
    rest_length: float
    rest_lengths: tuple[float, float]
    whose: str
    lock: float
    thread_length: float
    closed: float
    largest_force: float

    def refuses(self, length: float, model_force: float) -> str | None:
        """Why nothing is said of a state, although the model has a force; None where something is.

        Beyond the braid's limits the geometry is that of no muscle, and a law that is asked far from
        its strains may give anything. At the measured lengths there is always an answer.

        Args:
            length: active length [m].
            model_force: there [N], not clipped; nan where the model has none.
        """
        low, high = self.lengths
        if not np.isfinite(model_force) or low <= length <= high:
            return None
        if length < self.lock:
            return self._below_lock
        if length > high and length > self.closed:
            return Sentence(
                "the length is beyond that at which the braid closes the bladder's bore, ",
                Quantity(self.closed, "length"),
            )
        if model_force > _MOST * self.largest_force:
            return Sentence(
                *("the length is so far beyond the measured ", *_range(low, high, "length")),
                *(" that the model's force, ", Quantity(model_force, "force")),
                f", is over {_MOST:g} times the largest measured",
            )
        return None

    @property
    def _below_lock(self) -> Sentence:
        lock = Quantity(self.lock, "length")
        return Sentence("the length is below the braid's lock at the neutral angle, ", lock)

    def leaves(self, length: float, pressure: float, answer: float | None) -> str | None:
        """Why a state is beyond what was fitted, the gravest reason; None where it is not.

        Args:
            length: active length [m].
            pressure: gauge pressure [Pa].
            answer: the force or onset there, None where there is none.
        """
        if answer is None and length >= self.thread_length:
            thread = Quantity(self.thread_length, "length")
            return Sentence("the length is beyond the thread's, ", thread)
        if length < self.lock:
            return self._below_lock
        for what, value, (low, high), kind in (
            ("length is beyond the measured", length, self.lengths, "length"),
            (f"rest length is beyond {self.whose}", self.rest_length, self.rest_lengths, "length"),
            ("pressure is beyond the measured", pressure, self.pressures, "pressure"),
        ):
            if kind == "pressure" and answer is None:
                return "there the muscle has neither a force nor an onset"
            if not low <= value <= high:
                return Sentence(f"the {what} ", *_range(low, high, kind))
        return None


def _range(low: float, high: float, kind: str) -> tuple[Quantity, str, Quantity]:
    return Quantity(low, kind), " to ", Quantity(high, kind)


def _reach_of(fit: SavedFit, rest_length: float | None) -> Reach:
    """What a saved fit covers, of the fitted muscle or of one of another rest length L0 [m]."""
    fitted = float(fit.muscle.geometry.rest_length)
    lengths, pressures, forces = fit.readings
    series = fit.document.get("series")
    asked = fitted if rest_length is None else rest_length
    if series is not None:
        ratios, pressures = np.array(series["length_ratios"]), series["pressures_Pa"]
        rest, whose = series["rest_lengths_m"], "the specimens'"
    else:
        ratios = lengths / fitted
        rest = (fitted / _FARTHEST, fitted * _FARTHEST)
        whose = f"{_FARTHEST:g} times the specimen's either way, as far as was tried:"
    muscle = fit.muscle if rest_length is None else famjax.cut_to_length(fit.muscle, rest_length)
    lock, thread = (float(at) for at in muscle.geometry.braid_limits())
    rounding = 1e-12 * asked
    return Reach(
        lengths=(float(ratios.min()) * asked - rounding, float(ratios.max()) * asked + rounding),
        pressures=(float(min(pressures)), float(max(pressures))),
        rest_length=asked,
        rest_lengths=(min(rest), max(rest)),
        whose=whose,
        lock=lock,
        thread_length=thread,
        closed=float(muscle.geometry.length_range()[1]),
        largest_force=float(forces.max()),
    )


def pressures_for(
    fit: SavedFit, length: Float[np.ndarray, " lengths"], force: Float[np.ndarray, " forces"]
) -> list[dict[str, Any]]:
    """At which gauge pressure a saved muscle pulls with each force at each length.

    Args:
        fit: from `load_fit`.
        length: active lengths [m] as the rig of the fit measures them, > 0.
        force: [N], >= 0.

    Returns:
        Rows with `length_m, force_N, pressure_Pa, inside, outside`: the lowest pressure up to the
        highest measured that gives the force, null where none does; for no force the highest at which
        the muscle is slack. Inside that contraction and pressure lie within the fitted data, and
        outside why they do not, or why there is no pressure.

    Raises:
        InputError: lengths or forces that no muscle has.
    """
    if not (length.size and force.size):
        raise InputError("a pressure is sought for a length and a force: give one of each or more")
    _check_lengths(length)
    if not (np.isfinite(force).all() and (force >= 0).all()):
        raise InputError(f"forces must be >= 0, as a muscle only pulls, got {force.min():.6g} N")
    muscle = famjax.muscle.MeanMuscle((fit.mounted, *fit.others), fit.weights)
    reach = _reach_of(fit, None)
    found = pressure_for_force(muscle, force, length[:, None], (0.0, reach.pressures[1]))
    rows = []
    for (k, j), code in np.ndenumerate(np.asarray(found.code)):
        at, wanted = float(length[k]), float(force[j])
        why = reach.refuses(at, float(found.force[k, j]))
        # Slack up to the highest pressure: no force is what it pulls at that one, too.
        attained = code == Outcome.FEASIBLE or (code == Outcome.FORCE_HIGH and wanted == 0)
        pressure = finite_or_none(float(found.pressure[k, j])) if attained and why is None else None
        if pressure is not None:
            why = reach.leaves(at, pressure, wanted)
        elif why is None:
            why = Outcome(int(code)).message
        row = {"length_m": at, "force_N": wanted, "pressure_Pa": pressure}
        rows.append(row | _outside(why))
    return rows


def predict_history(fit: SavedFit, history: History) -> list[dict[str, Any]]:
    """What a saved muscle pulls at each point of a history, on whichever branch it is.

    The history begins where the cycles of the fitted records do: relaxed, and vented at the first
    length; after strokes, at the longest length under the first pressure. It may turn round at any
    reading, and moves one way between two of them.

    Args:
        fit: from `load_fit`, of `famjax assess --hysteresis`.
        history: lengths and pressures in the order of time.

    Returns:
        A row for each reading, as `predict` gives them, with `time_s` where there are times:
        `static_force_N` is that of the static map, `hysteresis_N` what the branch adds to it, and
        `force_N` their sum, 0 where the muscle is slack on that branch: `model_force_N` is the sum
        of the unclipped ones. Its error band is that of the static map, widened by
        `hysteresis_error`; `inside` is that of the static map.

    Raises:
        InputError: the fit has no hysteresis.
    """
    if fit.hysteresis is None:
        raise InputError(
            "the fit has no hysteresis, so that a history does not matter: fit raw ramps with "
            "famjax assess --hysteresis, or ask for lengths and pressures"
        )
    L, P = history.length, history.pressure
    added = np.asarray(fit.hysteresis.along(L, P), float)
    missed = hysteresis_error(fit)
    static = model_forces(fit, L, P)
    model, std = static.force + added, np.hypot(static.std, missed)
    half = np.hypot(static.half, NORMAL_95 * missed)
    # A slack reading of the static map says nothing of the upper branch.
    said = reported(model, half, np.zeros(L.size, bool), static.narrowest)
    found = []
    for k, row in enumerate(static_rows(fit, L, P)):
        figures = _figures(said, model, std, static.band, k)
        first = {} if history.time is None else {"time_s": float(history.time[k])}
        for name in ("length_m", "pressure_Pa"):
            first[name] = row[name]
        first |= {"force_N": figures["force_N"], "static_force_N": row["force_N"]}
        found.append(first | {"hysteresis_N": finite_or_none(added[k])} | row | figures)
    return found


def hysteresis_error(fit: SavedFit) -> float:
    """RMS error [N] of what the branches add: the largest on what was left out, or in sample.

    The error of half the branches' difference is that of either branch, as their mean is the static map.
    """
    entry = fit.document["hysteresis"]
    return max((one["rms_N"] for one in entry["left_out"].values()), default=entry["rms_N"])
