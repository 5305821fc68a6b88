"""What is known of an identification besides its optimum: validation, profiles, bootstrap."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from famjax.boundary.tasks import AnyExecutor
from famjax.boundary.units import finite_or_none, from_si, si_unit, unit_system

from ..posterior.report import posterior_as_dict, posterior_table, posterior_warnings
from ..posterior.result import Posterior
from ..records.hysteresis import (
    HysteresisFit,
    hysteresis_as_dict,
    hysteresis_table,
    hysteresis_warnings,
)
from ..result import Identification
from .leave_out import groups_of, leave_out_each
from .left_out import LeftOut
from .likelihood import LEVELS, Profile, profile
from .model_error import ModelError, model_error
from .resampling import Bootstrap, bootstrap
from .shared_errors import Carried, Moves, carry
from .validation import validate

Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]
"""Title, header and rows of text."""

_DISAGREE = 1.5
"""Factor between two estimates of one error bar beyond which a reader is warned."""


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Validation and uncertainty of an identification; whatever was not asked for is empty.

    Attributes:
        validations: by leave-one-out.
        profiles: of the parameters.
        bootstrap: replicates, or None.
        hysteresis: of both branches, or None.
        error: of predictions, as readings left out show it; None of a law that depends on pressure
            and of specimens identified together.
        left_out: errors of the fit itself on groups of "pressure" and "length" left out, which the error
            is made of; empty where it is None.
        posterior: draws, or None.
        shared: what errors that all readings share do, or None.
    """

    validations: tuple[LeftOut, ...] = ()
    profiles: tuple[Profile, ...] = ()
    bootstrap: Bootstrap | None = None
    hysteresis: HysteresisFit | None = None
    error: ModelError | None = None
    left_out: Mapping[str, LeftOut] = dataclasses.field(default_factory=dict)
    posterior: Posterior | None = None
    shared: Carried | None = None

    @property
    def empty(self) -> bool:
        """Whether nothing was asked for."""
        return not any(
            found for name, found in vars(self).items() if name not in {"error", "left_out"}
        )


def gather(
    result: Identification,
    *,
    validation: bool,
    profiles: bool,
    replicates: int,
    seed: int,
    executor: AnyExecutor = None,
    progress: Callable[[str, int, int], None],
    known: tuple[ModelError, Mapping[str, LeftOut]] | None = None,
    posterior: bool = False,
    noise: float | None = None,
    shared: Moves | None = None,
) -> Evidence:
    """The evidence that was asked for, with `progress(what, done, total)` as it comes.

    Args:
        result: the fit.
        validation: leave out each pressure and each length.
        profiles: profile likelihoods.
        replicates: of the bootstrap.
        seed: of the bootstrap.
        executor: what fits replicates, see `bootstrap`; nothing else takes long enough.
        progress: called as it comes.
        known: the error of predictions and the errors on what was left out that it is made of, where a
            choice knows them; found by leaving out otherwise.
        posterior: draw from it.
        noise: standard deviation of a reading [N], where it is known, of the posterior.
        shared: errors that all readings share, see `carry`.
    """
    validations = [
        validate(result, kind, progress=functools.partial(progress, f"leave one {kind} out"))
        for kind in (left_out_kinds(result) if validation else ())
    ]
    found = ()
    if profiles:
        found = profile(result, progress=functools.partial(progress, "profile likelihood"))
    drawn = None
    if replicates:
        drawn = bootstrap(
            result, replicates, seed=seed, executor=executor,
            progress=functools.partial(progress, "bootstrap"),
        )  # fmt: skip
    sampled = None
    if posterior:
        from ..posterior.sampling import sample  # noqa: PLC0415 -- most fits ask for none

        told = functools.partial(progress, "posterior")
        sampled = sample(result, noise=noise, seed=seed, progress=told)
    error, left_out = _error(result) if known is None else known
    return Evidence(
        validations=tuple(validations),
        profiles=found,
        bootstrap=drawn,
        error=error,
        left_out=left_out,
        posterior=sampled,
        shared=carry(result, shared) if shared else None,
    )


def _error(result: Identification) -> tuple[ModelError | None, Mapping[str, LeftOut]]:
    """The error of predictions, by leaving out each length and groups of neighbouring pressures."""
    problem = result.problem
    if result.dependence != "fixed" or len(problem.parts) > 1:
        return None, {}
    kinds = {kind: (groups_of(problem, kind), 1) for kind in ("length", "pressure")}
    found = leave_out_each([(problem, result.end.u)], kinds)[0]
    left_out = {kind: one for kind, one in found.items() if np.isfinite(one.error).all()}
    return model_error(result.data, result.residuals, left_out, result.n_parameters), left_out


def left_out_kinds(result: Identification) -> tuple[str, ...]:
    """What can be left out: coefficients free in pressure say nothing of another pressure."""
    data = result.data
    kinds = ("length",) if result.dependence == "free" else ("pressure", "length")
    return tuple(kind for kind in kinds if np.unique(data.levels(kind)[data.loaded]).size > 1)


def evidence_as_dict(evidence: Evidence) -> dict[str, Any]:
    """The evidence as JSON-ready data in SI; null where there is no number."""
    document: dict[str, Any] = {}
    if evidence.error is not None:
        document["model_error"] = evidence.error.as_dict()
    for one in evidence.validations:
        document[f"leave_one_{one.groups}_out"] = {
            "rmse_N": finite_or_none(one.rmse),
            "interior_rmse_N": finite_or_none(one.interior_rmse),
            "left_out": one.values.tolist(),
            "group_rmse_N": [finite_or_none(value) for value in one.group_rmse],
        }
    if evidence.profiles:
        document["profiles"] = {
            one.name: {
                "verdict": one.verdict,
                "unit": si_unit(one.kind),
                "values": one.values.tolist(),
                "excess": [finite_or_none(v) for v in one.excess],
                **{
                    f"interval_{100 * level:.0f}": [finite_or_none(end) for end in ends]
                    for level, ends in one.intervals.items()
                },
            }
            for one in evidence.profiles
        }
    if evidence.bootstrap is not None:
        drawn = evidence.bootstrap
        document["bootstrap"] = {
            "replicates": len(drawn.samples),
            "failed": drawn.failed,
            "units": "SI",
            "stderr": {name: finite_or_none(value) for name, value in drawn.stderr.items()},
            "interval_95": {name: drawn.interval(name) for name in drawn.names},
            "band_95_N": drawn.band().tolist(),
        }
    if evidence.hysteresis is not None:
        document["hysteresis"] = hysteresis_as_dict(evidence.hysteresis)
    if evidence.posterior is not None:
        document["posterior"] = posterior_as_dict(evidence.posterior)
    if evidence.shared is not None:
        document["shared_errors"] = evidence.shared.by_source()
    return document


def evidence_tables(evidence: Evidence, result: Identification, system: str) -> list[Table]:
    """The evidence as tables of text in a unit system."""
    tables: list[Table] = []
    if evidence.validations:
        unit = unit_system(system)["force"]

        def force(value: float) -> str:
            return f"{from_si(value, unit, 'force'):.4g}" if math.isfinite(value) else "none"

        rows = [("in sample", force(result.errors.rmse), "")]
        rows += [
            (f"leave one {one.groups} out", force(one.rmse), force(one.interior_rmse))
            for one in evidence.validations
        ]
        tables.append(("Validation", ("RMSE", unit, "without the extremes"), rows))
    if evidence.profiles:
        tables.append(_profile_table(evidence.profiles, system))
    if evidence.bootstrap is not None:
        tables.append(_bootstrap_table(evidence.bootstrap, result, system))
    if evidence.hysteresis is not None:
        tables.append(hysteresis_table(evidence.hysteresis, system))
    if evidence.posterior is not None:
        tables.append(posterior_table(evidence.posterior, system))
    if evidence.shared is not None:
        tables.append(_budget(evidence.shared, result, system))
    return tables


def _profile_table(profiles: tuple[Profile, ...], system: str) -> Table:
    def interval(one: Profile, level: float) -> str:
        unit = unit_system(system)[one.kind]
        low, high = (from_si(end, unit, one.kind) for end in one.intervals[level])
        left = f"{low:.5g}" if math.isfinite(low) else "open"
        right = f"{high:.5g}" if math.isfinite(high) else "open"
        return f"{left} to {right}"

    rows = [
        (
            one.name,
            unit_system(system)[one.kind],
            *(interval(one, at) for at in LEVELS),
            one.verdict,
        )
        for one in profiles
    ]
    levels = tuple(f"{100 * at:.0f} %" for at in LEVELS)
    return "Profile likelihood", ("parameter", "unit", *levels, "verdict"), rows


def _bootstrap_table(drawn: Bootstrap, result: Identification, system: str) -> Table:
    rows = []
    for estimate in result.estimates:
        if estimate.name not in drawn.names:
            continue
        unit, kind = unit_system(system)[estimate.kind], estimate.kind
        low, high = (from_si(end, unit, kind) for end in drawn.interval(estimate.name))
        error = from_si(drawn.stderr[estimate.name], unit, kind)
        text = f"{error:.2g}" if math.isfinite(error) else "none"
        rows.append((estimate.name, unit, text, f"{low:.5g} to {high:.5g}"))
    failed = f", {drawn.failed} more did not converge" if drawn.failed else ""
    title = f"Bootstrap, {len(drawn.samples)} replicates{failed}"
    return title, ("parameter", "unit", "std. error", "95 %"), rows


def _budget(shared: Carried, result: Identification, system: str) -> Table:
    """Standard errors of every parameter by source, and of all together."""
    scatter = np.sqrt(np.diag(result.covariance))
    units = {one.name: (unit_system(system)[one.kind], one.kind) for one in result.estimates}
    rows = []
    for k, name in enumerate(shared.names):
        if name not in units or not math.isfinite(scatter[k]):
            continue
        unit, kind = units[name]
        every = [float(scatter[k]), *shared.effects[:, k].tolist()]
        total = math.hypot(*every)
        # What has no effect has one of rounding.
        shown = (
            f"{from_si(one, unit, kind):.2g}" if one > 1e-9 * total else "0"
            for one in (*every, total)
        )  # fmt: skip
        rows.append((name, unit, *shown))
    sources = (source.replace("_", " ") for source in shared.sources)
    return (
        "Standard errors by source",
        ("parameter", "unit", "scatter", *sources, "all together"),
        rows,
    )


def evidence_warnings(evidence: Evidence, result: Identification) -> tuple[str, ...]:
    """Where the levels of evidence disagree."""
    found = []
    for one in evidence.profiles:
        if one.verdict in {"flat", "one-sided"}:
            side = "on neither side" if one.verdict == "flat" else "on one side only"
            found.append(f"The data bound {one.name} {side} (profile likelihood).")
    spread = {} if evidence.bootstrap is None else evidence.bootstrap.stderr
    for estimate in result.estimates:
        drawn = spread.get(estimate.name, math.nan)
        ratio = drawn / estimate.stderr if estimate.stderr else math.nan
        if math.isfinite(ratio) and not 1 / _DISAGREE < ratio < _DISAGREE:
            found.append(
                f"The standard error of {estimate.name} by bootstrap is {ratio:.2g} times that of "
                "the linear theory: believe neither too far."
            )
    for one in evidence.validations:
        if one.rmse > 2 * result.errors.rmse and np.isfinite(one.rmse):
            found.append(
                f"With one {one.groups} left out the error is {one.rmse / result.errors.rmse:.2g} "
                "times that in sample: do not extrapolate in it."
            )
    if evidence.hysteresis is not None:
        found += hysteresis_warnings(evidence.hysteresis)
    if evidence.posterior is not None:
        own = result.residuals * np.sqrt(result.weights)
        if result.data.force_std is not None:
            own = own / result.data.force_std[result.data.loaded]
        found += posterior_warnings(evidence.posterior, float(np.sqrt(np.mean(own**2))))
    return tuple(found)
