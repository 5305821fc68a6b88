"""Predictions by a fit: forces with error bands, onsets, pressures, and forces along a history.

A model is smooth through zero, as roots and gradients need it. What a reading can be is not: a muscle
buckles, and does not push. Below zero it is 0 N, and so are both ends of its band.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Collection, Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import Quantity, Sentence, finite_or_none
from famjax.control import Outcome, pressure_for_force

from .arguments import check_numbers
from .bands import Pull, disagreement, muscle_spread, pull
from .records.hysteresis import History
from .result import Identification, check_identified

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
    fit: Identification,
    length: Float[np.ndarray, " lengths"],
    pressure: Float[np.ndarray, " pressures"],
    *,
    onset: bool = False,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> list[dict[str, Any]]:
    """What an identified muscle does at every pair of a length and a pressure.

    Args:
        fit: from `load_fit` or `identify`.
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
    check_identified(fit)
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


def _check_cut(muscle: famjax.AbstractMuscle, rest_length: float) -> None:
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
    fit: Identification,
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
    gives_way, reach = float(fit.mounted.compliance) > 0, _reach_of(fit, rest_length)
    rows = []
    for k, figures in enumerate(_figures(found, seen)):
        at = float(length[k]), float(pressure[k])
        row = {"length_m": at[0], "pressure_Pa": at[1]} | figures
        if gives_way:
            row["muscle_force_N"] = finite_or_none(np.maximum(found.muscle_force[k], 0.0))
        rows.append(row | _outside(found.refused[k] or reach.leaves(*at, row["force_N"])))
    return rows


def _outside(why: str | None) -> dict[str, Any]:
    return {"inside": why is None, "outside": why}


@dataclasses.dataclass(frozen=True)
class ModelForces:
    """Forces of a fit, not clipped; nan where there is none.

    Attributes:
        force: what the rig of the fit would measure if the muscle could push [N].
        muscle_force: of the muscle alone, were it of that length itself [N].
        std: standard deviation of a reading about the force [N].
        half: half of the 95 % band [N].
        narrowest: half of the band where the model is known best [N]; 0 where nothing was left out.
        band: what the band is made of, None where there is none.
        refused: why nothing is said of a state of which the model has a force, see `Reach.refuses`.
    """

    force: Float[np.ndarray, " n"]
    muscle_force: Float[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]
    half: Float[np.ndarray, " n"]
    narrowest: float
    band: str | None
    refused: list[str | None]


def model_forces(
    fit: Identification,
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
    *,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> ModelForces:
    """What the model of a fit says, before a muscle that cannot push is thought of.

    Args:
        fit: from `load_fit` or `identify`.
        length: active lengths [m].
        pressure: gauge pressures [Pa], one for each length.
        rest_length: as for `predict`.
        length_std: as for `predict`.
    """
    reach, error = _reach_of(fit, rest_length), fit.outlook.error
    found = _pull(fit, length, pressure, rest_length, length_std)
    std, factor, band = _band(fit, found, length, pressure, rest_length)
    refused = [reach.refuses(*at) for at in zip(length.tolist(), found.force.tolist(), strict=True)]
    unknown = np.array([why is not None for why in refused]) | ~np.isfinite(found.force)
    force, alone, std, half = (
        np.where(unknown, np.nan, one)
        for one in (found.force, found.muscle_force, std, factor * std)
    )
    narrowest = 0.0 if error is None else error.narrowest
    return ModelForces(force, alone, std, half, narrowest, band, refused)


def _pull(
    fit: Identification,
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
    outlook, weights = fit.outlook, None
    if rest_length is not None and outlook.other_lengths:
        of_each = [of(one, None, length_std=length_std) for one in outlook.other_lengths.values()]
        reading = np.nan_to_num(of_each[0].std)  # by the error of the lengths alone
        std = np.hypot(np.std([one.force for one in of_each], axis=0), reading)
    else:
        own = None if _by_what_was_left_out(fit) else _directions(fit)
        varied = [one for one in (own, outlook.shared) if one is not None and len(one)]
        first = of(fit.mounted, np.concatenate(varied) if varied else None, length_std=length_std)
        of_each, std = [first, *(of(one, None) for one in outlook.others)], first.std
        weights = outlook.weights
    force, alone = (
        np.average([getattr(one, name) for one in of_each], axis=0, weights=weights)
        for name in ("force", "muscle_force")
    )
    return Pull(force, alone, std)


def _directions(fit: Identification) -> Float[np.ndarray, "directions numbers"]:
    """In which the muscle's numbers vary; by linear theory where nothing else is known."""
    known = fit.outlook.directions
    return muscle_spread(fit) if known is None else known


def _band(
    fit: Identification,
    found: Pull,
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
    rest_length: float | None,
) -> tuple[np.ndarray, np.ndarray | float, str | None]:
    """Standard deviation of a reading, how many of them on either side are 95 %, and what it is of."""
    outlook, error = fit.outlook, fit.outlook.error
    theory = "bootstrap" if outlook.bootstrap else "linear"
    std, factor, band = np.full(length.size, np.nan), NORMAL_95, None
    if outlook.series is not None:
        # Leaving a specimen out leaves the error of the parameters in.
        std, band = np.maximum(found.std, outlook.series["between_N"]), f"{theory}, specimens"
    elif rest_length is not None:
        # One specimen does not tell how specimens differ, nor its braid from its rig.
        if outlook.other_lengths:
            std, band = np.hypot(found.std, outlook.between), "one specimen"
    elif error is not None:
        differ = disagreement(found.force, outlook.alike.values(), length, pressure)
        factor = error.factor()
        model = error.half_band(length, pressure, differ) / factor
        if outlook.bootstrap:
            std, band = np.maximum(model, found.std), f"left out, {theory}"
        else:
            std, band = np.hypot(model, found.std), "left out"
            # No reading left out shows an error that all share: it is stated, and normal.
            student, normal = factor * model, NORMAL_95 * found.std
            factor = np.hypot(student, normal) / np.where(std > 0, std, 1.0)
        if outlook.shared is not None and len(outlook.shared):
            band += ", shared errors"
    elif len(_directions(fit)):
        std, band = found.std, theory
    return std, factor, band


def _by_what_was_left_out(fit: Identification) -> bool:
    """Whether the band is made of errors on readings left out, those of the parameters among them."""
    return fit.outlook.error is not None and not fit.outlook.bootstrap


def _figures(found: ModelForces, seen_slack: Bool[np.ndarray, " n"]) -> list[dict[str, Any]]:
    """What rows say of forces that may be below zero, where a muscle only pulls.

    Args:
        found: not clipped.
        seen_slack: where a reading says that the muscle does not pull, see `seen_slack`.
    """
    slack, low, high = reported(found.force, found.half, seen_slack, found.narrowest)
    columns = np.where(slack, 0.0, found.force), found.force, found.std, low, high
    names = "force_N", "model_force_N", "force_std_N", "low_95_N", "high_95_N"
    return [
        dict(zip(names, map(finite_or_none, figures), strict=True))
        | {
            "band": found.band if np.isfinite(figures[2]) else None,
            "slack": bool(is_slack) if np.isfinite(figures[1]) else None,
        }
        for is_slack, *figures in zip(slack, *columns, strict=True)
    ]


def reported(
    model_force: Float[np.ndarray, " n"],
    half: Float[np.ndarray, " n"],
    seen_slack: Bool[np.ndarray, " n"],
    narrowest: float = 0.0,
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """What a reading would be by a model that may be below zero.

    Args:
        model_force: [N], not clipped.
        half: half of its 95 % band [N], nan where nothing is known of it.
        seen_slack: where a reading says that the muscle does not pull, see `seen_slack`.
        narrowest: half of the band where the model is known best [N], see `ModelError.narrowest`: by so
            much a reading may be above 0 where the model is below.

    Returns:
        (whether the model does not pull; lower end of the 95 % band [N], >= 0, and 0 wherever the
        muscle is or was slack; upper end [N], > 0).
    """
    slack, low = model_force <= _ROUNDING, model_force - half
    low = np.where(slack | seen_slack, np.minimum(low, 0.0), low)
    return slack, np.maximum(low, 0.0), np.maximum(model_force + half, narrowest)


def seen_slack(
    fit: Identification, length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Where a reading says that the muscle does not pull.

    A muscle that was slack is so, too, when it is shorter and under less pressure. A reading that is
    contradicted, by a pull at no greater length and no higher pressure, says nothing.

    Args:
        fit: with its readings.
        length: active lengths [m] of the muscle that was measured.
        pressure: gauge pressures [Pa].
    """
    L, P, pulls = fit.data.length, fit.data.pressure, ~fit.data.slack
    contradicted = ((L[pulls] <= L[~pulls, None]) & (P[pulls] <= P[~pulls, None])).any(axis=1)
    L, P = L[~pulls][~contradicted], P[~pulls][~contradicted]
    within = (length[:, None] <= (1 + _SAME) * L) & (pressure[:, None] <= (1 + _EXACT) * P)
    return np.asarray(within.any(axis=1))


def _onset_row(
    fit: Identification, reach: "Reach", length: float, rest_length: float | None
) -> dict[str, Any]:
    """The pressure at which the muscle begins to pull, between the readings where it was measured."""

    def force(pressure: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return _pull(fit, np.full(pressure.shape, length), pressure, rest_length).muscle_force

    gauge, (low, high) = onset_pressure(force, _ONSET_REACH * reach.pressures[1]), (None, None)
    if rest_length is None:
        low, high = _measured_onset(fit, length)
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


def _measured_onset(fit: Identification, length: float) -> tuple[float | None, float | None]:
    """The pressures between which a muscle of that length was seen to begin to pull.

    Returns:
        (highest pressure [Pa] at which it was slack, 0 where it never was; lowest at which it
        pulled); None at a length that was not measured, or where readings contradict one another.
    """
    pressure, force = fit.data.pressure, fit.data.force
    here = np.abs(fit.data.length - length) <= _SAME * length
    low = float(pressure[here & (force <= 0)].max(initial=0.0))
    high = float(pressure[here & (force > 0)].min(initial=math.inf))
    return (low, high) if low <= high < math.inf else (None, None)


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
            return _beyond("below the braid's lock at the neutral angle, ", self.lock)
        if length > high and length > self.closed:
            words = "beyond that at which the braid closes the bladder's bore, "
            return _beyond(words, self.closed)
        if model_force > _MOST * self.largest_force:
            return Sentence(
                *("the length is so far beyond the measured ", *_range(low, high, "length")),
                *(" that the model's force, ", Quantity(model_force, "force")),
                f", is over {_MOST:g} times the largest measured",
            )
        return None

    def leaves(self, length: float, pressure: float, answer: float | None) -> str | None:
        """Why a state is beyond what was fitted, the gravest reason; None where it is not.

        Args:
            length: active length [m].
            pressure: gauge pressure [Pa].
            answer: the force or onset there, None where there is none.
        """
        if answer is None and length >= self.thread_length:
            return _beyond("beyond the thread's, ", self.thread_length)
        if length < self.lock:
            return _beyond("below the braid's lock at the neutral angle, ", self.lock)
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


def _beyond(what: str, length: float) -> Sentence:
    return Sentence(f"the length is {what}", Quantity(length, "length"))


def _range(low: float, high: float, kind: str) -> tuple[Quantity, str, Quantity]:
    return Quantity(low, kind), " to ", Quantity(high, kind)


def _ends(values: Collection[float]) -> tuple[float, float]:
    return float(min(values)), float(max(values))


def _braid_limits(muscle: famjax.AbstractMuscle) -> Sequence[Any]:
    """Lengths [m] at which the braid locks and at which its threads are straight, nan where unknown."""
    if isinstance(muscle, famjax.EquilibriumMuscle):
        return math.nan, muscle.braid.rest_thread_length
    assert isinstance(muscle, famjax.Muscle)
    return muscle.geometry.braid_limits()


def _reach_of(fit: Identification, rest_length: float | None) -> Reach:
    """What a fit covers, of the fitted muscle or of one of another rest length L0 [m]."""
    fitted, series = float(fit.muscle.rest_length), fit.outlook.series
    asked = fitted if rest_length is None else rest_length
    ratios, pressures = fit.data.length / fitted, fit.data.pressure
    rest = fitted / _FARTHEST, fitted * _FARTHEST
    whose = f"{_FARTHEST:g} times the specimen's either way, as far as was tried:"
    if series is not None:
        ratios, pressures = np.array(series["length_ratios"]), series["pressures_Pa"]
        rest, whose = series["rest_lengths_m"], "the specimens'"
    muscle = fit.muscle if rest_length is None else famjax.cut_to_length(fit.muscle, rest_length)
    lock, thread = (float(at) for at in _braid_limits(muscle))
    rounding, (low, high) = 1e-12 * asked, _ends(ratios)
    return Reach(
        lengths=(low * asked - rounding, high * asked + rounding),
        pressures=_ends(pressures),
        rest_length=asked,
        rest_lengths=_ends(rest),
        whose=whose,
        lock=lock,
        thread_length=thread,
        closed=float(muscle.length_range()[1]),
        largest_force=float(fit.data.force.max()),
    )


def pressures_for(
    fit: Identification, length: Float[np.ndarray, " lengths"], force: Float[np.ndarray, " forces"]
) -> list[dict[str, Any]]:
    """At which gauge pressure an identified muscle pulls with each force at each length.

    Args:
        fit: from `load_fit` or `identify`.
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
    outlook, reach = fit.outlook, _reach_of(fit, None)
    muscle = famjax.muscle.MeanMuscle((fit.mounted, *outlook.others), outlook.weights)
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


def predict_history(fit: Identification, history: History) -> list[dict[str, Any]]:
    """What an identified muscle pulls at each point of a history, on whichever branch it is.

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
        of the unclipped ones. Its error band is that of the static map, widened by the error of the
        branches; `inside` is that of the static map.

    Raises:
        InputError: the fit has no hysteresis.
    """
    outlook = fit.outlook
    if outlook.hysteresis is None:
        raise InputError(
            "the fit has no hysteresis, so that a history does not matter: fit raw ramps with "
            "famjax assess --hysteresis, or ask for lengths and pressures"
        )
    L, P, missed = history.length, history.pressure, outlook.branches_error
    added = np.asarray(outlook.hysteresis.along(L, P), float)
    static = model_forces(fit, L, P)
    # A slack reading of the static map says nothing of the upper branch.
    moving = dataclasses.replace(
        static, force=static.force + added, std=np.hypot(static.std, missed),
        half=np.hypot(static.half, NORMAL_95 * missed),
    )  # fmt: skip
    found = []
    both = zip(static_rows(fit, L, P), _figures(moving, np.zeros(L.size, bool)), strict=True)
    for k, (row, figures) in enumerate(both):
        first = {} if history.time is None else {"time_s": float(history.time[k])}
        first |= {name: row[name] for name in ("length_m", "pressure_Pa")}
        first |= {"force_N": figures["force_N"], "static_force_N": row["force_N"]}
        found.append(first | {"hysteresis_N": finite_or_none(added[k])} | row | figures)
    return found


def hysteresis_error(fit: Identification) -> float:
    """RMS error [N] of what the branches add: the largest on what was left out, or in sample.

    The error of half the branches' difference is that of either branch, as their mean is the static map.
    """
    return fit.outlook.branches_error
