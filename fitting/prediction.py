"""Predict with a fit: forces with error bands, onset pressures, and forces along a history.

The model is smooth through zero, as roots and gradients require. A real muscle buckles and does not push,
so a reported force and both ends of its band are never below 0 N.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Collection, Sequence
from typing import Any, TypeAlias

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import Quantity, Sentence, finite_or_none
from famjax.control import Outcome, pressure_for_force

from .arguments import check_numbers
from .bands import Column, Pull, disagreement, muscle_spread, pull
from .records.hysteresis import History
from .result import Identification, check_identified

Row: TypeAlias = dict[str, Any]

NORMAL_95 = 1.96
"""Half-width of a 95 % normal interval, in standard deviations."""

_SAME = 5e-4  # relative difference below which two lengths are the same

_FARTHEST = 3.4
"""Ratio of rest lengths up to which predictions from one specimen were tested (83 and 281 mm)."""

_MOST = 10.0
"""Force beyond the measured lengths, relative to the largest reading, above which a law is not trusted."""


def predict(
    fit: Identification,
    length: Float[np.ndarray, " lengths"],
    pressure: Float[np.ndarray, " pressures"],
    *,
    onset: bool = False,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> list[Row]:
    """Predict the force of an identified muscle at every pair of a length and a pressure.

    Args:
        fit: from `load_fit` or `identify`.
        length: active lengths [m] as measured by the rig of the fit, > 0.
        pressure: gauge pressures [Pa], >= 0; may be empty with `onset`.
        onset: also return the pressure at which the force rises from zero at each length.
        rest_length: L0 [m] of another muscle of the same series, see `famjax.cut_to_length`; None for
            the fitted muscle.
        length_std: standard deviation of the lengths [m], for the error band.

    Returns:
        Rows with `length_m, pressure_Pa, force_N, model_force_N, slack, inside, outside`.
        `model_force_N` is the force that the rig would measure if the muscle could push, and `force_N`
        is the same clipped at 0; `slack` is true where the model does not pull. All three are null if
        the model has no force, beyond the limits of the braid, and where the force beyond the measured
        lengths exceeds ten times the largest reading. `inside` is true if contraction and pressure (and
        rest length, in a series) are within the fitted data; otherwise `outside` gives the reason.
        `force_std_N` is the standard deviation of a reading about the model's force. The interval from
        `low_95_N` to `high_95_N` contains 95 % of the readings. It includes 0 where the muscle is slack,
        and where a slack reading at no smaller length and no lower pressure shows the same. The error is
        null if unknown: at another rest length, it is known only for a series and for a model
        chosen without stated deadband and rig. In the latter case the force is the mean over all models
        that the map cannot refute, see `fitting.series.accounts`. `band` names the sources of error:
        "left out" (see `ModelError`), "bootstrap" or "linear" for the parameters, "specimens" of a
        series, "one specimen" for another rest length, and "shared errors" if stated. With a compliant
        rig, `muscle_force_N` is the force of the muscle alone at that length, 0 if slack.
        With `onset`, rows `length_m, onset_pressure_Pa, slack_up_to_Pa, pulls_from_Pa, inside, outside`
        follow; null if there is no onset. At a measured length, the onset lies between the highest
        pressure of a slack reading and the lowest pressure of a pull.

    Raises:
        InputError: lengths, pressures or the rest length are not possible.
    """
    check_identified(fit)
    length, pressure = (
        np.atleast_1d(check_numbers(name, given))
        for name, given in (("length", length), ("pressure", pressure))
    )
    if not length.size or not (pressure.size or onset):
        raise InputError("a prediction needs a length, and also a pressure unless onset is set")
    _check_lengths(length)
    if not (np.isfinite(pressure).all() and (pressure >= 0).all()):
        raise InputError(f"gauge pressures must be >= 0, got {pressure.min():.6g} Pa")
    if not (math.isfinite(length_std) and length_std >= 0):
        raise InputError(f"the standard deviation of a length must be >= 0, got {length_std} m")
    if rest_length is not None:
        _check_cut(fit.muscle, rest_length)
    rows: list[Row] = []
    if pressure.size:
        L, P = (grid.ravel() for grid in np.meshgrid(length, pressure, indexing="ij"))
        rows += static_rows(fit, L, P, rest_length=rest_length, length_std=length_std)
    if onset:
        rows += [_onset_row(fit, float(at), rest_length) for at in length]
    return rows


def _check_lengths(length: Column) -> None:
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise InputError(f"lengths must be > 0, got {length.min():.6g} m")


def _check_cut(muscle: famjax.AbstractMuscle, rest_length: float) -> None:
    if not (math.isfinite(rest_length) and rest_length > 0):
        raise InputError(f"the rest length must be > 0, got {rest_length:.6g} m")
    cannot = f"a muscle of this fit cannot be cut to {rest_length:.4g} m"
    try:
        famjax.cut_to_length(muscle, rest_length)
    except ValueError as error:
        raise InputError(f"{cannot}: {error}") from None
    except eqx.EquinoxRuntimeError:
        raise InputError(f"{cannot}: its rounded ends are longer than that") from None


def static_rows(
    fit: Identification,
    length: Column,
    pressure: Column,
    *,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> list[Row]:
    """Rows of `predict` at valid pairs of lengths and pressures."""
    found = model_forces(fit, length, pressure, rest_length=rest_length, length_std=length_std)
    seen = np.zeros(length.size, bool)
    if rest_length is None:
        seen = seen_slack(fit, length, pressure)
    gives_way, reach = float(fit.mounted.compliance) > 0, Reach(fit, rest_length)
    rows = []
    for k, figures in enumerate(_figures(found, seen)):
        at = float(length[k]), float(pressure[k])
        row = {"length_m": at[0], "pressure_Pa": at[1]} | figures
        if gives_way:
            row["muscle_force_N"] = finite_or_none(np.maximum(found.muscle_force[k], 0.0))
        rows.append(row | _outside(found.refused[k] or reach.leaves(*at, row["force_N"])))
    return rows


def _outside(why: str | None) -> Row:
    return {"inside": why is None, "outside": why}


@dataclasses.dataclass(frozen=True)
class ModelForces:
    """Unclipped forces of a fit; nan where there is none.

    Attributes:
        force: force that the rig would measure if the muscle could push [N].
        muscle_force: force of the muscle alone at the same length [N].
        std: standard deviation of a reading about the force [N].
        half: half-width of the 95 % band [N].
        narrowest: half-width where the model is known best [N]; 0 without held-out readings.
        band: sources of error in the band; None if there is no band.
        refused: reason why a force of the model is not reported, see `Reach.refuses`.
    """

    force: Column
    muscle_force: Column
    std: Column
    half: Column
    narrowest: float
    band: str | None
    refused: list[str | None]


def model_forces(
    fit: Identification,
    length: Column,
    pressure: Column,
    *,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> ModelForces:
    """Evaluate the model of a fit without clipping negative forces.

    Args:
        fit: from `load_fit` or `identify`.
        length: active lengths [m].
        pressure: gauge pressures [Pa], one for each length.
        rest_length: see `predict`.
        length_std: see `predict`.
    """
    reach, error = Reach(fit, rest_length), fit.outlook.error
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
    length: Column,
    pressure: Column,
    rest_length: float | None,
    length_std: float = 0.0,
) -> Pull:
    """Forces in the rig and of the muscle alone, with the standard deviation by linear theory.

    For a series, average over its two rig models with the deviation of the first. For another rest
    length of a chosen model, average over all models that predict other lengths.
    """
    of = functools.partial(pull, length=length, pressure=pressure, rest_length=rest_length)
    outlook, weights = fit.outlook, None
    if rest_length is not None and outlook.other_lengths:
        of_each = [of(one, None, length_std=length_std) for one in outlook.other_lengths.values()]
        reading = np.nan_to_num(of_each[0].std)  # from the errors of the lengths only
        std = np.hypot(np.std([one.force for one in of_each], axis=0), reading)
    else:
        # Errors on held-out readings already include those of the parameters.
        own = _directions(fit) if outlook.error is None or outlook.bootstrap else None
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
    """Directions in which the muscle's numbers vary, by linear theory unless known otherwise."""
    known = fit.outlook.directions
    return muscle_spread(fit) if known is None else known


def _band(
    fit: Identification, found: Pull, length: Column, pressure: Column, rest_length: float | None
) -> tuple[np.ndarray, np.ndarray | float, str | None]:
    """Standard deviation of a reading, half-width of the 95 % band in units of it, and its sources."""
    outlook, error = fit.outlook, fit.outlook.error
    theory = "bootstrap" if outlook.bootstrap else "linear"
    std, factor, band = np.full(length.size, np.nan), NORMAL_95, None
    if outlook.series is not None:
        # Errors on held-out specimens already include those of the parameters.
        std, band = np.maximum(found.std, outlook.series["between_N"]), f"{theory}, specimens"
    elif rest_length is not None:
        # One specimen cannot show how specimens differ, or separate its braid from its rig.
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
            # Held-out readings cannot show shared errors; these are stated and normal.
            student, normal = factor * model, NORMAL_95 * found.std
            factor = np.hypot(student, normal) / np.where(std > 0, std, 1.0)
        if outlook.shared is not None and len(outlook.shared):
            band += ", shared errors"
    elif len(_directions(fit)):
        std, band = found.std, theory
    return std, factor, band


def _figures(found: ModelForces, seen_slack: Bool[np.ndarray, " n"]) -> list[Row]:
    """Entries of each row for a muscle that only pulls."""
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
    model_force: Column, half: Column, seen_slack: Bool[np.ndarray, " n"], narrowest: float = 0.0
) -> tuple[Bool[np.ndarray, " n"], Column, Column]:
    """Convert a model force, which may be negative, into the range of a reading.

    Args:
        model_force: unclipped force [N].
        half: half-width of its 95 % band [N]; nan if unknown.
        seen_slack: true where a reading shows a slack muscle, see `seen_slack`.
        narrowest: half-width where the model is known best [N], see `ModelError.narrowest`; the upper end
            is at least this.

    Returns:
        (true where the model does not pull; lower end of the 95 % band [N], >= 0, and 0 wherever the
        muscle is or was slack; upper end [N], > 0).
    """
    slack, low = model_force <= 1e-9, model_force - half
    low = np.where(slack | seen_slack, np.minimum(low, 0.0), low)
    return slack, np.maximum(low, 0.0), np.maximum(model_force + half, narrowest)


def seen_slack(fit: Identification, length: Column, pressure: Column) -> Bool[np.ndarray, " n"]:
    """True where a reading shows that the muscle does not pull.

    A slack muscle stays slack if it is shortened or its pressure is reduced. A slack reading is ignored
    if another reading pulls at no greater length and no higher pressure.

    Args:
        fit: a fit with its readings.
        length: active lengths [m] of the measured muscle.
        pressure: gauge pressures [Pa].
    """
    L, P, pulls = fit.data.length, fit.data.pressure, ~fit.data.slack
    contradicted = ((L[pulls] <= L[~pulls, None]) & (P[pulls] <= P[~pulls, None])).any(axis=1)
    L, P = L[~pulls][~contradicted], P[~pulls][~contradicted]
    # Pressures converted from another unit differ by rounding.
    within = (length[:, None] <= (1 + _SAME) * L) & (pressure[:, None] <= (1 + 1e-9) * P)
    return np.asarray(within.any(axis=1))


def _onset_row(fit: Identification, length: float, rest_length: float | None) -> Row:
    """Onset pressure of the muscle, limited by the readings at a measured length."""
    reach = Reach(fit, rest_length)

    def force(pressure: Column) -> Column:
        return _pull(fit, np.full(pressure.shape, length), pressure, rest_length).muscle_force

    # Predictions beyond three times the highest measured pressure mean nothing.
    gauge, low, high = onset_pressure(force, 3.0 * reach.pressures[1]), None, None
    if rest_length is None:
        here, pulls = np.abs(fit.data.length - length) <= _SAME * length, fit.data.force > 0
        low = float(fit.data.pressure[here & ~pulls].max(initial=0.0))
        high = float(fit.data.pressure[here & pulls].min(initial=math.inf))
        if not low <= high < math.inf:  # not measured, or contradicted
            low = high = None
        elif math.isfinite(gauge):
            gauge = min(max(gauge, low), high)
    begins = max(gauge, reach.pressures[0])  # an onset below the measured pressures is valid
    return {
        "length_m": length,
        "onset_pressure_Pa": finite_or_none(gauge),
        "slack_up_to_Pa": low,
        "pulls_from_Pa": high,
        **_outside(reach.leaves(length, begins, finite_or_none(gauge))),
    }


def onset_pressure(force: Callable[[Column], Column], highest: float) -> float:
    """Find the onset pressure at one length from sampled forces, without compiling anything.

    Search from the highest pressure down in 64 steps for the first one in which the force falls through
    zero, and refine that step in the same way to full precision.

    Args:
        force: F(P) [N] at 65 gauge pressures [Pa] and a fixed length.
        highest: upper end of the search [Pa].

    Returns:
        P [Pa]; nan if the force does not fall through zero.
    """
    upper, lower, rounding = highest, 0.0, np.nan
    while True:
        grid = np.linspace(upper, lower, 65)
        pull = force(grid)
        if np.isnan(rounding):
            known = np.abs(pull[np.isfinite(pull)])
            rounding = 64 * np.finfo(float).eps * known.max(initial=0.0)
        if grid[-1] == 0 and abs(pull[-1]) <= rounding:  # at rest length without deadband
            pull[-1] = 0.0
        falls = np.flatnonzero((pull[:-1] > 0) & (pull[1:] <= 0))
        if not falls.size:
            return np.nan
        upper, lower = grid[falls[0]], grid[falls[0] + 1]
        if upper - lower <= 4 * np.finfo(float).eps * highest:
            return float(lower)


class Reach:
    """Range covered by a fit, for the fitted muscle or one with another rest length L0 [m].

    Attributes:
        lengths: shortest and longest active length [m], scaled to the requested muscle.
        pressures: lowest and highest gauge pressure [Pa].
        rest_length: rest length of the requested muscle [m].
        rest_lengths: shortest and longest rest length [m] of the specimens, or the tested range about a
            single specimen.
        whose: description of `rest_lengths`.
        lock: active length [m] at the neutral angle; nan without a braid.
        thread_length: active length [m] at which the unloaded threads are straight; nan without a braid.
        closed: longest active length [m], at which the braid closes the bladder's bore.
        largest_force: largest measured force [N].
    """

    def __init__(self, fit: Identification, rest_length: float | None) -> None:
        muscle, fitted, series = fit.muscle, float(fit.muscle.rest_length), fit.outlook.series
        ratios, pressures = fit.data.length / fitted, fit.data.pressure
        rest = fitted / _FARTHEST, fitted * _FARTHEST
        self.whose = f"the tested range, {_FARTHEST:g} times the specimen's either way:"
        if series is not None:
            ratios, pressures = np.array(series["length_ratios"]), series["pressures_Pa"]
            rest, self.whose = series["rest_lengths_m"], "the specimens'"
        if rest_length is not None:
            muscle = famjax.cut_to_length(muscle, rest_length)
        self.rest_length = fitted if rest_length is None else rest_length
        rounding, (low, high) = 1e-12 * self.rest_length, _ends(ratios)
        self.lengths = low * self.rest_length - rounding, high * self.rest_length + rounding
        self.pressures, self.rest_lengths = _ends(pressures), _ends(rest)
        self.lock, self.thread_length = (float(at) for at in _braid_limits(muscle))
        self.closed = float(muscle.length_range()[1])
        self.largest_force = float(fit.data.force.max())

    def refuses(self, length: float, model_force: float) -> str | None:
        """Return the reason for not reporting a force of the model; None if it is reported.

        Beyond the limits of the braid the geometry is not physical, and far from the measured strains the
        law is arbitrary. States within the measured lengths are always reported.

        Args:
            length: active length [m].
            model_force: unclipped force [N]; nan if the model has none.
        """
        low, high = self.lengths
        if not np.isfinite(model_force) or low <= length <= high:
            return None
        if length < self.lock:
            return _beyond("below the braid's lock at the neutral angle, ", self.lock)
        if length > high and length > self.closed:
            return _beyond("beyond the one that closes the bladder's bore, ", self.closed)
        if model_force > _MOST * self.largest_force:
            return Sentence(
                *("the length is so far beyond the measured ", *_range(low, high, "length")),
                *(" that the model's force, ", Quantity(model_force, "force")),
                f", is over {_MOST:g} times the largest measured",
            )
        return None

    def leaves(self, length: float, pressure: float, answer: float | None) -> str | None:
        """Return the most serious reason why a state is outside the fitted data; None if it is inside.

        Args:
            length: active length [m].
            pressure: gauge pressure [Pa].
            answer: the force or onset pressure; None if there is none.
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
                return "the muscle has neither a force nor an onset there"
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
    """Active lengths [m] at which the braid locks and the threads are straight; nan if unknown."""
    if isinstance(muscle, famjax.EquilibriumMuscle):
        return math.nan, muscle.braid.rest_thread_length
    assert isinstance(muscle, famjax.Muscle)
    return muscle.geometry.braid_limits()


def pressures_for(
    fit: Identification, length: Float[np.ndarray, " lengths"], force: Float[np.ndarray, " forces"]
) -> list[Row]:
    """Find the gauge pressure at which an identified muscle pulls with each force at each length.

    Args:
        fit: from `load_fit` or `identify`.
        length: active lengths [m] as measured by the rig of the fit, > 0.
        force: forces [N], >= 0.

    Returns:
        Rows with `length_m, force_N, pressure_Pa, inside, outside`. The pressure is the lowest one, up
        to the highest measured, that gives the force, or null; for zero force it is the highest pressure
        of a slack muscle. `inside` is true if contraction and pressure are within the fitted data;
        otherwise `outside` gives the reason.

    Raises:
        InputError: lengths or forces are not possible.
    """
    if not (length.size and force.size):
        raise InputError("a pressure needs a length and a force: give at least one of each")
    _check_lengths(length)
    if not (np.isfinite(force).all() and (force >= 0).all()):
        raise InputError(f"forces must be >= 0, as a muscle only pulls; got {force.min():.6g} N")
    outlook, reach = fit.outlook, Reach(fit, None)
    muscle = famjax.muscle.MeanMuscle((fit.mounted, *outlook.others), outlook.weights)
    found = pressure_for_force(muscle, force, length[:, None], (0.0, reach.pressures[1]))
    rows = []
    for (k, j), code in np.ndenumerate(np.asarray(found.code)):
        at, wanted = float(length[k]), float(force[j])
        why = reach.refuses(at, float(found.force[k, j]))
        # Slack up to the highest pressure: zero force is attained there.
        attained = code == Outcome.FEASIBLE or (code == Outcome.FORCE_HIGH and wanted == 0)
        pressure = finite_or_none(float(found.pressure[k, j])) if attained and why is None else None
        if pressure is not None:
            why = reach.leaves(at, pressure, wanted)
        elif why is None:
            why = Outcome(int(code)).message
        row = {"length_m": at, "force_N": wanted, "pressure_Pa": pressure}
        rows.append(row | _outside(why))
    return rows


def predict_history(fit: Identification, history: History) -> list[Row]:
    """Predict the force along a history of lengths and pressures, including hysteresis.

    The history starts where the cycles of the fitted records do: for ramps relaxed and vented at the
    first length, for strokes at the longest length under the first pressure. It may reverse at any
    reading and is monotonic between readings.

    Args:
        fit: from `load_fit`, written by `famjax assess --hysteresis`.
        history: lengths and pressures in order of time.

    Returns:
        One row for each reading, as from `predict`, with `time_s` if there are times. `static_force_N` is
        the force of the static map, and `hysteresis_N` the difference of the branch from it.
        `model_force_N` is the unclipped sum, and `force_N` the sum clipped at 0. The error band of the
        static map is widened by the error of the branches; `inside` refers to the static map.

    Raises:
        InputError: the fit has no hysteresis.
    """
    outlook = fit.outlook
    if outlook.hysteresis is None:
        raise InputError(
            "the fit has no hysteresis, so the history has no effect: fit raw ramps with "
            "famjax assess --hysteresis, or predict at lengths and pressures"
        )
    L, P, missed = history.length, history.pressure, outlook.branches_error
    added = np.asarray(outlook.hysteresis.along(L, P), float)
    static = model_forces(fit, L, P)
    # A slack reading of the static map does not restrict the upper branch.
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
    """RMS error [N] of either branch about the static map: the largest held-out or in-sample error."""
    return fit.outlook.branches_error
