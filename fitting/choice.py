"""Choose the model family that best predicts held-out readings."""

import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.tasks import AnyExecutor, run_tasks
from famjax.boundary.units import finite_or_none, from_si, unit_system

from .arguments import check_whole
from .bands import ModelError, disagreement, model_error, where_they_differ
from .data import ForceData, groups_of_levels
from .identification import solve
from .ladder import MODEL_ERROR, ladder
from .mechanics import check_ends, equilibrium_candidate
from .parameters import Parameter
from .race import (
    ALIKE,
    LITTLE_MORE,
    NEAR,
    Fitted,
    Tried,
    fitted,
    left_out_of,
    posed_of,
    preferred,
    ranked,
)
from .result import Identification, Outlook
from .search import check_objective
from .series import FROM_ONE, accounts
from .validation import LeftOut, levels_of_groups

_NO_FORCE = (
    "in every family, the force is undefined (nan) at one or more readings: narrow the bounds"
)
_COMPARED = 4  # starts of each family
_HOPELESS = 4.0  # times the least RMSE in sample: nothing is left out of such a family


@dataclasses.dataclass(frozen=True)
class Choice:
    """The model for a map, chosen by cross-validation.

    Attributes:
        data: the map.
        chosen: fit of the chosen family, used for predictions. Its `outlook` contains the prediction error,
            the families that fit the data equally well, and the models for other rest lengths.
        tried: all families: the chosen one first, then the others in order of held-out error.
        dropped: sentences about families that were left out, and other remarks on the choice.
        open_question: a sentence that states where families that fit equally well differ, and which further
            readings would decide between them; "" if they agree.
    """

    data: ForceData
    chosen: Identification
    tried: tuple[Tried, ...]
    dropped: tuple[str, ...]
    open_question: str = ""

    def __repr__(self) -> str:
        return f"<Choice {self.data.specimen.name}: {self.name} of {len(self.tried)} families>"

    @property
    def error(self) -> ModelError:
        """Prediction error, estimated from held-out readings."""
        error = self.chosen.outlook.error
        assert error is not None
        return error

    @property
    def alike(self) -> Mapping[str, famjax.MountedMuscle]:
        """Muscles of the other families that fit the data equally well, by name."""
        return self.chosen.outlook.alike

    @property
    def name(self) -> str:
        """Name of the chosen family."""
        return self.tried[0].candidate.name

    @property
    def left_out(self) -> Mapping[str, LeftOut]:
        """Held-out errors of the chosen family, by "pressure" and "length"."""
        return self.tried[0].left_out

    @property
    def clear(self) -> str:
        """Statement of how clearly the chosen family outperforms the others."""
        first, *others = self.tried
        if not others:
            return f"Only {self.name} could be tried: the map is too small for other families."
        near = [
            f"'{one.candidate.name}'" for one in others if one.held_out <= NEAR * first.held_out
        ]
        best = min(self.tried, key=lambda one: one.held_out)
        found = f"{self.name} predicts held-out readings best."
        if first.held_out > NEAR * best.held_out:
            found = (
                f"The held-out error of '{best.candidate.name}' is smaller, {best.held_out:.3g} N compared "
                f"with {first.held_out:.3g} N. The map has too few lengths to rely on this difference, so "
                f"the simpler one, '{self.name}', is kept."
            )
        elif near:
            found = (
                f"The choice is not clear: {', '.join(near)} and '{self.name}' predict held-out readings "
                f"about equally well. '{self.name}' is kept."
            )
        if self.alike:
            found += (
                f" The RMSE of {'; '.join(self.alike)} is at most {ALIKE:g} times the smallest, so the "
                "error band includes the disagreement between these models."
            )
        return found

    def _repr_html_(self) -> str:
        from .evidence import Evidence  # noqa: PLC0415 -- evidence needs a choice's parts
        from .report import Findings  # noqa: PLC0415 -- it draws

        evidence = Evidence(error=self.error, left_out=self.left_out)
        return Findings(self.chosen, evidence, self).html()

    def predict(
        self, length: Float[np.ndarray, "..."], pressure: Float[np.ndarray, "..."]
    ) -> Float[np.ndarray, "..."]:
        """Predict the force [N] at lengths [m] and gauge pressures [Pa], which are broadcast."""
        return self.chosen.predict(length, pressure)

    def half_band(
        self, length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Return the half-width [N] of the 95 % band for readings at lengths [m] and pressures [Pa]."""
        force = self.predict(length, pressure)
        return self.error.half_band(
            length, pressure, disagreement(force, self.alike.values(), length, pressure)
        )


def choose(
    data: ForceData,
    *,
    constraint: str = "drucker",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    parameters: Mapping[str, Parameter] | None = None,
    noise: float | None = None,
    objective: str = "sum_of_squares",
    ends: str = "cylinder",
    other_lengths: bool = True,
    starts: int = 16,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> Choice:
    """Choose the model for a force map by cross-validating a ladder of families.

    Each family is fitted to all readings. It is then refitted with each length, and each group of
    neighbouring pressures, left out in turn. The family with the smallest held-out error is chosen. If the
    map has too few lengths to leave one out, the first family on the ladder within 1.5 times the smallest
    error is chosen. Families whose RMSE exceeds four times the smallest are not cross-validated. A family
    without a certified optimum is passed over if a family with one has at most twice the smallest error.

    Args:
        data: the map.
        constraint: constraint on the coefficients of every family, as in `identify`.
        bounds: intervals by parameter name, the same for every family.
        parameters: bounds, fixed values and priors, the same for every family.
        noise: standard deviation of one reading [N]; taken from the data if omitted.
        objective: objective with which the chosen family is fitted.
        ends: "equilibrium" also tries Ogden's law with the shape computed from mechanics, see `identify`.
        other_lengths: also fit the models that predict muscles of other rest lengths, see `predict`.
        starts: number of starts for the chosen family; the comparison uses at most four for each family.
        seed: random seed for the starts.
        progress: called with (task, steps done, total steps).

    Returns:
        The chosen model, and the results of all families.

    Raises:
        InputError: the data cannot support the simplest family; see `identify`.
        RuntimeError: float64 is off.
    """
    check_whole("starts", starts, 1)
    check_objective(objective)
    candidates, dropped = ladder(data, parameters, bounds)
    weighed = weigh(data, noise)
    if not candidates:
        raise InputError(
            f"{int(data.loaded.sum())} loaded readings at "
            f"{np.unique(data.lengths.level[data.loaded]).size} lengths cannot determine any model: "
            "measure at two or more lengths, at least one of them shorter than the rest length"
        )
    posed_of(weighed, candidates[0], constraint)  # refused here: it is no muscle

    def tell(what: str) -> Callable[[int, int], None] | None:
        return None if progress is None else functools.partial(progress, what)

    said = {*(bounds or {}), *(parameters or {})}
    elsewhere = accounts(candidates, data, said) if other_lengths else ()
    if check_ends(ends, {}) == "equilibrium":
        candidates = (*candidates, equilibrium_candidate(weighed, bounds, parameters, seed))
    found = fitted(
        weighed, constraint, min(starts, _COMPARED), seed, [*candidates, *elsewhere],
        tell("fitting all families"),
    )  # fmt: skip
    told = list(zip(candidates, found, strict=False))
    families = [fit for _, fit in told if isinstance(fit, Fitted)]
    for why in dict.fromkeys(one for _, one in told if isinstance(one, str)):
        dropped += (
            f"Not considered: {'; '.join(one.name for one, of in told if of == why)}. {why}",
        )
    if not families:
        raise InputError(_NO_FORCE)
    least = min(one.rmse for one in families)
    # Rigid rigs come first, so that they do not wait for the iteration of compliant ones.
    judged = sorted(
        (k for k, one in enumerate(families) if one.rmse <= _HOPELESS * least),
        key=lambda k: families[k].candidate.rig,
    )
    errors = left_out_of([families[k] for k in judged], seed, tell("cross-validating"))
    left_out = dict(zip(judged, errors, strict=True))
    tried = ranked(
        [(one.candidate, one.rmse, left_out.get(k)) for k, one in enumerate(families)],
        data.max_force,
    )
    order = preferred(tried)

    # The first family with a certified optimum whose error is close to the smallest; else the best.
    fits: dict[int, Identification] = {}
    near = LITTLE_MORE * min(one.held_out for one in tried)
    for place in order:
        if fits and tried[place].held_out > near:
            break
        posed = families[place].posed
        points = np.concatenate([families[place].ends, posed.starts(starts, seed)])[:starts]
        with contextlib.suppress(InputError):
            fits[place], *_ = solve(
                posed, points, objective=objective, seed=seed,
                progress=tell(f"identifying: {tried[place].candidate.name}"),
            )  # fmt: skip
            if fits[place].converged:
                break
    if not fits:
        raise InputError(_NO_FORCE)
    place = next((k for k, fit in fits.items() if fit.converged), next(iter(fits)))
    passed = [tried[k].candidate.name for k in order[: order.index(place)]]
    part = families[place].problem.force.size
    if part < (whole := families[place].posed.problem.force.size):
        dropped += (
            f"{part} of {whole} readings, spread evenly, were used to choose the model and to compute the "
            "held-out errors. The chosen model was then fitted to all readings.",
        )
    dropped += tuple(f"{name} was not chosen: its fit did not converge." for name in passed)
    winner, chosen = tried[place], fits[place]
    alike = {
        one.candidate.name: one.mounted
        for k, one in enumerate(families) if tried[k].alike and k != place
    }  # fmt: skip
    others = [one for one in found[len(candidates) :] if isinstance(one, Fitted)]
    outlook = Outlook(
        model_error(data, chosen.residuals, winner.left_out, winner.candidate.unknowns),
        alike=alike,
        other_lengths={one.candidate.name: one.mounted for one in others},
        between=FROM_ONE * data.max_force if others else math.nan,
    )
    return Choice(
        data=data,
        chosen=dataclasses.replace(chosen, data=data, outlook=outlook),
        tried=(winner, *(tried[k] for k in order if k != place)),
        dropped=dropped,
        open_question=where_they_differ(data, chosen.mounted, alike.values()),
    )


def weigh(data: ForceData, noise: float | None = None) -> ForceData:
    """Return the map with the model error added to the standard deviations of its readings.

    Args:
        data: the map.
        noise: standard deviation of one reading [N]; taken from the data if omitted.
    """
    own = noise or (0.0 if data.force_std is None else data.force_std)
    std = np.hypot(own, MODEL_ERROR * data.max_force)
    return dataclasses.replace(data, force_std=np.broadcast_to(std, data.force.shape).copy())


_HEADER = {
    "pressure": "held-out pressures",
    "interior length": "held-out interior lengths",
    "end length": "held-out end lengths",
}
"""Column headers for the held-out errors, by kind."""


def choice_as_dict(choice: Choice) -> dict[str, Any]:
    """Return the choice as a JSON-ready dictionary in SI units."""
    return {
        "chosen": choice.name,
        "clear": choice.clear,
        "open_question": choice.open_question or None,
        "set_aside": list(choice.dropped),
        "tried": [
            {
                "family": one.candidate.name,
                "unknowns": one.candidate.unknowns,
                "rmse_N": one.rmse,
                **{
                    f"{kind.replace(' ', '_')}s_out_rmse_N": one.columns.get(kind)
                    for kind in _HEADER
                },
                "held_out_N": finite_or_none(one.held_out),
                "fits_alike": one.alike,
            }
            for one in choice.tried
        ],
    }


def choice_table(choice: Choice, system: str) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    """Return the title, header and rows of a table: the chosen family, then others by held-out error."""
    unit = unit_system(system)["force"]

    def force(value: float) -> str:
        return f"{from_si(value, unit, 'force'):.4g}" if np.isfinite(value) else ""

    kinds = [kind for kind in _HEADER if kind in choice.tried[0].columns]
    rows = [
        (
            one.candidate.name, str(one.candidate.unknowns), force(one.rmse),
            *(force(one.columns.get(kind, np.inf)) for kind in kinds), force(one.held_out),
            "chosen" if one is choice.tried[0] else "fits equally well" * one.alike,
        )
        for one in choice.tried
    ]  # fmt: skip
    title = (
        f"RMSE of all models tried, {unit}. Held-out error: geometric mean of the held-out columns."
    )
    out = (_HEADER[kind] for kind in kinds)
    return title, ("family", "unknowns", "in sample", *out, "held-out error", ""), rows


_STARTS = 4
MOST = 20
"""Largest number of folds."""


@dataclasses.dataclass(frozen=True)
class NestedValidation(LeftOut):
    """Errors at readings that were used neither to fit the models nor to choose between them.

    Each "pressure" or each "length" was left out in turn; if there are many, neighbouring ones were left
    out together.

    Attributes:
        inside: whether each reading lies within the 95 % band of its prediction.
        width: full width [N] of that band.
        names: name of the family that was chosen when each group was left out.
    """

    inside: Bool[np.ndarray, " points"]
    width: Float[np.ndarray, " points"]
    names: tuple[str, ...]

    @property
    def covered(self) -> float:
        """Fraction of the readings inside their 95 % bands."""
        return float(np.mean(self.inside))


def validate_choice(
    choice: Choice,
    groups: str = "length",
    *,
    most: int = MOST,
    executor: AnyExecutor = None,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> NestedValidation:
    """Cross-validate a choice: repeat it without each pressure or length, and predict the omitted readings.

    Each repeated choice takes about five seconds on one core for 100 readings. Two processes save time if
    there are four or more levels.

    Args:
        choice: result of `choose`.
        groups: "pressure" or "length".
        most: largest number of groups; if there are more levels, neighbouring ones are left out together.
        executor: executor for the repeated choices, each of which is a task, see
            `famjax.boundary.tasks.AnyExecutor`. It does not affect the results.
        progress: called with (levels done, total levels).
        options: options of the original call to `choose`; each fold uses at most four starts.

    Raises:
        InputError: the executor failed.
    """
    options["starts"] = min(options.get("starts", _STARTS), _STARTS)
    data = choice.data
    levels = data.levels(groups)[data.loaded]
    group = groups_of_levels(levels, np.unique(levels), most)
    store = run_tasks(
        functools.partial(_fold, data, groups, group, options), range(int(group.max()) + 1),
        executor=executor, progress=progress,
        names=[f"{groups} {value:.6g}" for value in levels_of_groups(levels, group)],
    )  # fmt: skip
    error, inside, width = np.zeros(levels.size), np.zeros(levels.size, bool), np.zeros(levels.size)
    names = []
    for k, part in enumerate(store):
        mine = group == k
        error[mine], inside[mine], width[mine] = part["error"], part["inside"], part["width"]
        names.append(part["name"])
    return NestedValidation(groups, levels, group, error, inside, width, tuple(names))


def _fold(
    data: ForceData,
    groups: str,
    group: Int[np.ndarray, " points"],
    options: Mapping[str, Any],
    k: int,
) -> dict[str, Any]:
    """Choose without one group of the loaded readings, and return the errors on that group."""
    mine, levels = group == k, data.levels(groups)
    kept = data.part(~np.isin(levels, levels[data.loaded][mine]))
    rest = choose(kept, other_lengths=False, **options)
    at = data.length[data.loaded][mine], data.pressure[data.loaded][mine]
    error = rest.predict(*at) - data.force[data.loaded][mine]
    half = rest.half_band(*at)
    return {
        "name": rest.name, "error": error, "inside": np.abs(error) <= half, "width": 2 * half,
    }  # fmt: skip
