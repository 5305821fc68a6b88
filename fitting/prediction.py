"""Make predictions from a fit: forces with error bands, onset pressures, and forces along a history.

The model's force passes smoothly through zero, as root finding and gradients require. A real muscle buckles
instead of pushing, so a reported force and both ends of its band are never below 0 N.
"""

import dataclasses
import functools
import math
from typing import Any, TypeAlias

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import Quantity, Sentence, finite_or_none
from famjax.compile_options import as_arrays, quick_jit
from famjax.control import Outcome, pressure_for_force

from .arguments import check_numbers
from .bands import Column, disagreement, muscle_spread, pull
from .records.hysteresis import History
from .result import Identification, check_identified

Row: TypeAlias = dict[str, Any]

NORMAL_95 = 1.96
"""Half-width of a 95 % normal interval, in standard deviations."""

_SAME = 5e-4  # relative difference below which two lengths are the same

_FARTHEST = 3.4
"""Largest ratio of rest lengths for which predictions from one specimen were tested (83 and 281 mm)."""

_ROUNDED = 1e-4  # of the rest length: a measured length typed with four digits is inside
_MOST = 10.0
"""Largest trusted force outside the measured lengths, relative to the largest reading."""


def predict(
    fit: Identification,
    length: Float[np.ndarray, " lengths"],
    pressure: Float[np.ndarray, " pressures"],
    *,
    onset: bool = False,
    rest_length: float | None = None,
) -> list[Row]:
    """Predict the force of an identified muscle at every combination of length and pressure.

    Args:
        fit: result of `load_fit` or `identify`.
        length: active lengths [m] as measured by the rig used for the fit, > 0.
        pressure: gauge pressures [Pa], >= 0; may be empty with `onset`.
        onset: also return the pressure at which the force rises from zero at each length.
        rest_length: L0 [m] of another muscle in the same series, see `famjax.cut_to_length`; None for
            the fitted muscle.

    Returns:
        Rows with `length_m, pressure_Pa, force_N, model_force_N, slack, inside, outside`.
        `model_force_N` is the force that the rig would measure if the muscle could push, and `force_N`
        is that force clipped at 0; `slack` is true where the model does not pull. All three are null
        where the model's force is undefined, beyond the limits of the braid, and where the force outside
        the measured lengths exceeds ten times the largest reading. `inside` is true if contraction and
        pressure (and rest length, in a series) are within the fitted data; otherwise `outside` states the
        reason.
        `force_std_N` is the standard deviation of a reading about the model's force. The interval from
        `low_95_N` to `high_95_N` contains 95 % of the readings. It includes 0 where the muscle is slack,
        and where it was slack in a reading at the same or a greater length and pressure. The error is
        null if it is unknown. At another rest length, it is known only for a series, and for a chosen
        model if the user specified neither a deadband nor a rig. In the latter case the force is the mean
        over all models that the map does not rule out, see `fitting.series.accounts`. `band`
        names the sources of error: "left out" (see `ModelError`), "bootstrap" or "linear" for the
        parameters, "specimens" for a series, "one specimen" for another rest length, and "shared errors"
        if these were stated.
        With `onset`, rows with `length_m, onset_pressure_Pa, inside, outside` follow. The onset pressure is
        null if there is no onset up to three times the highest measured pressure.

    Raises:
        InputError: a length, a pressure or the rest length is impossible.
    """
    check_identified(fit)
    length = np.atleast_1d(check_numbers("length", length))
    pressure = np.atleast_1d(check_numbers("pressure", pressure))
    if not length.size or not (pressure.size or onset):
        raise InputError(
            "a prediction needs at least one length and, unless onset is set, at least one pressure"
        )
    _check_lengths(length)
    if not (np.isfinite(pressure).all() and (pressure >= 0).all()):
        raise InputError(f"gauge pressures must be >= 0, got {pressure.min():.6g} Pa")
    if rest_length is not None:
        if not (math.isfinite(rest_length) and rest_length > 0):
            raise InputError(f"the rest length must be > 0, got {rest_length:.6g} m")
        try:
            famjax.cut_to_length(fit.muscle, rest_length)
        except (ValueError, eqx.EquinoxRuntimeError):
            cannot = f"this muscle cannot be cut to {rest_length:.4g} m"
            raise InputError(
                f"{cannot}: its ends are longer than this, or its geometry was measured"
            ) from None
    rows: list[Row] = []
    if pressure.size:
        L, P = (grid.ravel() for grid in np.meshgrid(length, pressure, indexing="ij"))
        rows += static_rows(fit, L, P, rest_length=rest_length)
    return rows + (_onsets(fit, length, rest_length) if onset else [])


def _check_lengths(length: Column) -> None:
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise InputError(f"lengths must be > 0, got {length.min():.6g} m")


def static_rows(
    fit: Identification,
    length: Column,
    pressure: Column,
    *,
    rest_length: float | None = None,
) -> list[Row]:
    """Return the rows of `predict` at valid pairs of length and pressure."""
    found = model_forces(fit, length, pressure, rest_length=rest_length)
    seen = np.zeros(length.size, bool)
    if rest_length is None:
        seen = seen_slack(fit, length, pressure)
    return [
        {"length_m": float(length[k]), "pressure_Pa": float(pressure[k])}
        | figures
        | _outside(found.outside[k])
        for k, figures in enumerate(_figures(found, seen))
    ]


def _outside(why: str | None) -> Row:
    return {"inside": why is None, "outside": why}


@dataclasses.dataclass(frozen=True)
class ModelForces:
    """Unclipped forces predicted by a fit; nan where the force is undefined or withheld.

    Attributes:
        force: force that the rig would measure if the muscle could push [N].
        std: standard deviation of a reading about the force [N].
        half: half-width of the 95 % band [N].
        narrowest: smallest half-width [N], where the model is known best; 0 without held-out readings.
        band: sources of error in the band; None if there is no band.
        outside: reason why each state is outside the fitted data, or None.
    """

    force: Column
    std: Column
    half: Column
    narrowest: float
    band: str | None
    outside: list[str | None]


def model_forces(
    fit: Identification,
    length: Column,
    pressure: Column,
    *,
    rest_length: float | None = None,
) -> ModelForces:
    """Evaluate the model of a fit without clipping negative forces.

    Args:
        fit: result of `load_fit` or `identify`.
        length: active lengths [m].
        pressure: gauge pressures [Pa], one for each length.
        rest_length: see `predict`.
    """
    outlook, error, reach = fit.outlook, fit.outlook.error, Reach(fit, rest_length)
    force, spread = _pull(fit, length, pressure, rest_length)
    theory = "bootstrap" if outlook.bootstrap else "linear"
    # Standard deviation of a reading, half-width of the band in units of it, and sources of error.
    std, factor, band = np.full(length.size, np.nan), np.asarray(NORMAL_95), None
    if outlook.series is not None:
        # Errors on held-out specimens already include those of the parameters.
        std, band = np.maximum(spread, outlook.series["between_N"]), f"{theory}, specimens"
    elif rest_length is not None:
        # One specimen cannot show how specimens differ, or separate its braid from its rig.
        if outlook.other_lengths:
            std, band = np.hypot(spread, outlook.between), "one specimen"
    elif error is not None:
        differ = disagreement(force, outlook.alike.values(), length, pressure)
        factor = np.asarray(error.factor())
        model = error.half_band(length, pressure, differ) / factor
        if outlook.bootstrap:
            std, band = np.maximum(model, spread), f"left out, {theory}"
        else:
            std, band = np.hypot(model, spread), "left out"
            # Held-out readings cannot show shared errors; these are stated and normal.
            student, normal = factor * model, NORMAL_95 * spread
            factor = np.hypot(student, normal) / np.where(std > 0, std, 1.0)
        if outlook.shared is not None and len(outlook.shared):
            band += ", shared errors"
    elif len(_directions(fit)):
        std, band = spread, theory
    states = zip(length.tolist(), pressure.tolist(), force.tolist(), strict=True)
    reasons = [reach.outside(*state) for state in states]
    unknown = np.array([refused for _, refused in reasons]) | ~np.isfinite(force)
    force, std, half = (np.where(unknown, np.nan, one) for one in (force, std, factor * std))
    narrowest = 0.0 if error is None else error.narrowest
    return ModelForces(force, std, half, narrowest, band, [why for why, _ in reasons])


def _pull(
    fit: Identification, length: Column, pressure: Column, rest_length: float | None
) -> tuple[Column, Column]:
    """Return the forces measured by the rig, with their standard deviation from linear theory.

    For a series, the force is averaged over its two rig models, and the standard deviation is that of the
    first. For a chosen model at another rest length, both come from all models that predict other lengths.
    """
    of = functools.partial(pull, length=length, pressure=pressure, rest_length=rest_length)
    outlook = fit.outlook
    if rest_length is not None and outlook.other_lengths:
        forces = [of(one, None)[0] for one in outlook.other_lengths.values()]
        return np.mean(forces, axis=0), np.std(forces, axis=0)
    # Errors on held-out readings already include those of the parameters.
    own = _directions(fit) if outlook.error is None or outlook.bootstrap else None
    varied = [one for one in (own, outlook.shared) if one is not None and len(one)]
    force, std = of(fit.mounted, np.concatenate(varied) if varied else None)
    forces = [force, *(of(one, None)[0] for one in outlook.others)]
    return np.average(forces, axis=0, weights=outlook.weights), std


def _directions(fit: Identification) -> Float[np.ndarray, "directions numbers"]:
    """Return the stored directions in which the muscle's numbers vary, or those from linear theory."""
    known = fit.outlook.directions
    return muscle_spread(fit) if known is None else known


def _figures(found: ModelForces, seen_slack: Bool[np.ndarray, " n"]) -> list[Row]:
    """Return the force entries of each row, for a muscle that can only pull."""
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
    """Convert a model force, which may be negative, to the range in which a reading is expected.

    Args:
        model_force: unclipped force [N].
        half: half-width of its 95 % band [N]; nan if unknown.
        seen_slack: true where a reading shows a slack muscle, see `seen_slack`.
        narrowest: smallest half-width [N], see `ModelError.narrowest`; the upper end of the band is at
            least this large.

    Returns:
        (true where the model does not pull; lower end of the 95 % band [N], >= 0, and 0 wherever the
        muscle is or was slack; upper end [N], > 0).
    """
    slack, low = model_force <= 1e-9, model_force - half
    low = np.where(slack | seen_slack, np.minimum(low, 0.0), low)
    return slack, np.maximum(low, 0.0), np.maximum(model_force + half, narrowest)


def seen_slack(fit: Identification, length: Column, pressure: Column) -> Bool[np.ndarray, " n"]:
    """Return True where a reading shows that the muscle does not pull.

    A slack muscle stays slack if it is shortened or its pressure is reduced. A slack reading is ignored
    if the muscle pulls in another reading at no greater length and no higher pressure.

    Args:
        fit: a fit with its readings.
        length: active lengths [m] of the muscle that was measured.
        pressure: gauge pressures [Pa].
    """
    L, P, pulls = fit.data.length, fit.data.pressure, ~fit.data.slack
    contradicted = ((L[pulls] <= L[~pulls, None]) & (P[pulls] <= P[~pulls, None])).any(axis=1)
    L, P = L[~pulls][~contradicted], P[~pulls][~contradicted]
    # Pressures converted from another unit differ by rounding.
    within = (length[:, None] <= (1 + _SAME) * L) & (pressure[:, None] <= (1 + 1e-9) * P)
    return np.asarray(within.any(axis=1))


@quick_jit
def _limits(muscle: famjax.AbstractMuscle) -> tuple[Any, Any, Any]:
    """Return the lengths [m] at which the braid locks, the threads are straight, and the bore closes."""
    lock = thread_length = math.nan
    if isinstance(muscle, famjax.Muscle):
        lock, thread_length = muscle.geometry.braid_limits()
    elif isinstance(muscle, famjax.EquilibriumMuscle):
        thread_length = muscle.braid.rest_thread_length
    return lock, thread_length, muscle.length_range()[1]


class Reach:
    """Range covered by a fit, for the fitted muscle or one with another rest length L0 [m].

    Attributes:
        lengths: shortest and longest active length [m], scaled to the requested muscle.
        pressures: lowest and highest gauge pressure [Pa].
        rest_length: rest length of the requested muscle [m].
        rest_lengths: shortest and longest rest length [m] of the specimens, or the tested range around
            a single specimen.
        whose: description of `rest_lengths`.
        lock: active length [m] at the neutral angle; nan without a braid.
        thread_length: active length [m] at which the unloaded threads are straight; nan without a braid.
        closed: longest active length [m], at which the braid closes the bladder's bore.
        largest_force: largest measured force [N].
    """

    def __init__(self, fit: Identification, rest_length: float | None) -> None:
        muscle, fitted, series = fit.muscle, float(fit.muscle.rest_length), fit.outlook.series
        ratios, pressures = fit.data.length / fitted, fit.data.pressure
        rest, self.whose = (fitted / _FARTHEST, fitted * _FARTHEST), "the tested range"
        if series is not None:
            ratios, pressures = np.array(series["length_ratios"]), series["pressures_Pa"]
            rest, self.whose = series["rest_lengths_m"], "the range of the specimens"
        if rest_length is not None:
            muscle = famjax.cut_to_length(muscle, rest_length)
        self.rest_length = fitted if rest_length is None else rest_length
        rounding = _ROUNDED * self.rest_length
        self.lengths = (
            float(min(ratios)) * self.rest_length - rounding,
            float(max(ratios)) * self.rest_length + rounding,
        )
        self.pressures = float(min(pressures)), float(max(pressures))
        self.rest_lengths = float(min(rest)), float(max(rest))
        self.lock, self.thread_length, self.closed = map(float, _limits(as_arrays(muscle)))
        self.largest_force = float(fit.data.force.max())

    def outside(
        self, length: float, pressure: float, model_force: float
    ) -> tuple[str | None, bool]:
        """Return the main reason why a state is outside the fitted data, and whether its force is withheld.

        Beyond the limits of the braid the geometry is not physical, and far from the measured strains the
        law is arbitrary. Within the measured lengths, a defined force is never withheld.

        Args:
            length: active length [m].
            pressure: gauge pressure [Pa].
            model_force: unclipped force [N]; nan if it is undefined.

        Returns:
            (reason, true if no force is reported); (None, False) inside the fitted data.
        """
        low, high = self.lengths
        measured, known = low <= length <= high, bool(np.isfinite(model_force))
        far = known and not measured and model_force > _MOST * self.largest_force
        lengths, rests = _range(self.lengths, "length"), _range(self.rest_lengths, "length")
        reasons: tuple[tuple[bool, bool, tuple[Any, ...]], ...] = (
            (not known and length >= self.thread_length, True,
             ("the length exceeds that of the threads, ", Quantity(self.thread_length, "length"))),
            (length < self.lock, not measured,
             ("the length is below that at which the braid locks (neutral angle), ",
              Quantity(self.lock, "length"))),
            (length > max(high, self.closed), True,
             ("the length exceeds that at which the braid closes the bladder's bore, ",
              Quantity(self.closed, "length"))),
            (far, True,
             ("the length is so far outside the measured range, ", *lengths, ", that the model's force, ",
              Quantity(model_force, "force"), f", is over {_MOST:g} times the largest measured force")),
            (not measured, False, ("the length is outside the measured range, ", *lengths)),
            (not self.rest_lengths[0] <= self.rest_length <= self.rest_lengths[1], False,
             (f"the rest length is outside {self.whose}, ", *rests)),
            (not known, True,
             ("the model has no force or onset at this length: the geometry is impossible there, or the "
              "muscle stays slack",)),
            (not self.pressures[0] <= pressure <= self.pressures[1], False,
             ("the pressure is outside the measured range, ", *_range(self.pressures, "pressure"))),
        )  # fmt: skip
        for holds, refused, parts in reasons:
            if holds:
                return Sentence(*parts), refused
        return None, False


def _range(ends: tuple[float, float], kind: str) -> tuple[Quantity, str, Quantity]:
    return Quantity(ends[0], kind), " to ", Quantity(ends[1], kind)


def _inverse(
    fit: Identification, force: Any, length: np.ndarray, highest: float, rest_length: float | None
) -> Any:
    """Return the lowest pressures that produce these forces, see `famjax.control.pressure_for_force`."""
    members, weights = [fit.mounted, *fit.outlook.others], fit.outlook.weights
    if rest_length is not None:
        if fit.outlook.other_lengths:
            members, weights = [*fit.outlook.other_lengths.values()], None
        members = [m.with_muscle(famjax.cut_to_length(m.muscle, rest_length)) for m in members]
    muscle = famjax.muscle.MeanMuscle(members, weights)
    return pressure_for_force(muscle, force, length, (0.0, highest))


def _onsets(fit: Identification, length: Column, rest_length: float | None) -> list[Row]:
    """Return a row with the onset pressure at each length."""
    reach, rows = Reach(fit, rest_length), []
    # Predictions beyond three times the highest measured pressure mean nothing.
    found = _inverse(fit, 0.0, length, 3.0 * reach.pressures[1], rest_length)
    for at, code, gauge in zip(length.tolist(), found.code, found.pressure, strict=True):
        onset = float(gauge) if code == Outcome.FEASIBLE else None
        # An onset below the measured pressures is valid.
        begins = max(onset or 0.0, reach.pressures[0])
        why, _ = reach.outside(at, begins, math.nan if onset is None else 0.0)
        if code == Outcome.FORCE_LOW:
            why = "the muscle already pulls at zero pressure"
        rows.append({"length_m": at, "onset_pressure_Pa": onset} | _outside(why))
    return rows


def pressures_for(
    fit: Identification, length: Float[np.ndarray, " lengths"], force: Float[np.ndarray, " forces"]
) -> list[Row]:
    """Find the gauge pressure at which an identified muscle exerts each force at each length.

    Args:
        fit: result of `load_fit` or `identify`.
        length: active lengths [m] as measured by the rig used for the fit, > 0.
        force: forces [N], >= 0.

    Returns:
        Rows with `length_m, force_N, pressure_Pa, inside, outside`. The pressure is the lowest one, up
        to the highest measured pressure, that produces the force; null if there is none. For zero force
        it is the highest pressure at which the muscle is slack. `inside` is true if contraction and
        pressure are within the fitted data; otherwise `outside` states the reason.

    Raises:
        InputError: a length or force is impossible.
    """
    if not (length.size and force.size):
        raise InputError("finding a pressure requires at least one length and at least one force")
    _check_lengths(length)
    if not (np.isfinite(force).all() and (force >= 0).all()):
        raise InputError(
            f"forces must be >= 0, because a muscle can only pull; got {force.min():.6g} N"
        )
    reach, rows = Reach(fit, None), []
    found = _inverse(fit, force, length[:, None], reach.pressures[1], None)
    for (k, j), code in np.ndenumerate(np.asarray(found.code)):
        at, wanted = float(length[k]), float(force[j])
        # Slack up to the highest pressure: zero force is attained there.
        attained = code == Outcome.FEASIBLE or (code == Outcome.FORCE_HIGH and wanted == 0)
        pressure = float(found.pressure[k, j])
        why, refused = reach.outside(at, pressure, float(found.force[k, j]))
        if not attained and not refused:
            why = Outcome(int(code)).message
        pressure = finite_or_none(pressure) if attained and not refused else None
        row = {"length_m": at, "force_N": wanted, "pressure_Pa": pressure}
        rows.append(row | _outside(why))
    return rows


def predict_history(fit: Identification, history: History) -> list[Row]:
    """Predict the force along a history of lengths and pressures, including hysteresis.

    The history is assumed to start where the cycles of the fitted records start: for ramps, relaxed and
    vented at the first length; for strokes, at the longest length under the first pressure. It may
    reverse at any reading and is monotonic between readings.

    Args:
        fit: fit loaded by `load_fit` from a file written by `famjax assess --hysteresis`.
        history: lengths and pressures in order of time.

    Returns:
        One row for each reading, as returned by `predict`, with `time_s` if the history contains times.
        `static_force_N` is the force of the static map, and `hysteresis_N` is the force on the branch minus
        the static force. `model_force_N` is the unclipped sum of the two, and `force_N` is that sum clipped
        at 0. The error band of the static map is widened by the error of the branches; `inside` refers to
        the static map.

    Raises:
        InputError: the fit has no hysteresis model.
    """
    outlook = fit.outlook
    if outlook.hysteresis is None:
        raise InputError(
            "the fit has no hysteresis model: run famjax assess --hysteresis, or predict static forces"
        )
    L, P, missed = history.length, history.pressure, outlook.branches_error
    added = np.asarray(outlook.hysteresis.along(L, P), float)
    static = model_forces(fit, L, P)
    # A slack reading of the static map does not restrict the upper branch.
    moving = dataclasses.replace(
        static, force=static.force + added, std=np.hypot(static.std, missed),
        half=np.hypot(static.half, NORMAL_95 * missed),
    )  # fmt: skip
    both = zip(static_rows(fit, L, P), _figures(moving, np.zeros(L.size, bool)), strict=True)
    return [
        ({} if history.time is None else {"time_s": float(history.time[k])})
        | {name: row[name] for name in ("length_m", "pressure_Pa", "force_N")}
        | {"static_force_N": row["force_N"], "hysteresis_N": finite_or_none(added[k])}
        | row
        | figures
        for k, (row, figures) in enumerate(both)
    ]
