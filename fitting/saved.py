"""Write a fit to `fit.json`, load it again, and make a muscle card from it."""

import dataclasses
import functools
import importlib.metadata
import json
import math
import platform
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError, NotTrustedError, Own, check_trusted, class_path
from famjax.boundary.files import Origin
from famjax.boundary.units import (
    Quantity,
    Sentence,
    finite_or_none,
    from_si,
    sentence_in_units,
    si_unit,
    unit_system,
)
from famjax.cards import (
    Covariance,
    MuscleCard,
    Provenance,
    draw,
    muscle_as_dict,
    muscle_from_dict,
    slip_from_dict,
)
from famjax.continuation import Region

from .arguments import check_path
from .bands import ModelError, muscle_spread
from .choice import Choice, choice_as_dict
from .data import COLUMNS, SPECIMEN_LENGTHS, ForceData, Specimen
from .evidence import Evidence, evidence_as_dict, evidence_warnings
from .families import EstimatedSource, KnownSource, Law, WrappedSource, law_named
from .mechanics import EquilibriumSource, SearchedLaw
from .parameters import Parameter
from .pictured import PictureFit
from .posing import EXCHANGES, pose
from .result import (
    Certificate,
    Errors,
    Estimate,
    Identification,
    Outlook,
    Solved,
    equivalent_sizes,
)
from .search import best_of, descend, refine
from .series import Series
from .verdict import Judgement, judge, judge_series

SCHEMA = "famjax-fit/2"
_WANTED = "give a fit.json written by famjax fit"

_ERRORS = {
    "rmse": "rmse_N", "mae": "mae_N", "max": "max_error_N", "max_force": "max_force_N",
    "n_points": "n_points", "n_slack": "n_slack", "slack_violations": "slack_violations",
    "max_slack_force": "max_slack_force_N",
}  # fmt: skip
_CERTIFICATE = {
    "stability_margin": "stability_margin_Pa", "slope_margin": "slope_margin_Pa",
    "constraint_margin": "constraint_margin_Pa", "between_stations": "between_stations",
    "kkt_residual": "kkt_residual", "duality_gap": "duality_gap",
    "gradient_residual": "gradient_residual", "condition": "condition", "n_starts": "n_starts",
    "n_agreeing": "n_starts_agreeing", "shape_margin": "shape_margin_N_per_m",
}  # fmt: skip
"""Key of each field in the file."""
_SAID = tuple(
    one.name
    for one in dataclasses.fields(ForceData)
    if one.name not in {*COLUMNS, "specimen", "notes", "assumed"}
)
"""Fields of a map that are saved under their own names."""
_KNOWN = "known"  # the geometry is given, such as a measured one
_MECHANICS = "equilibrium"  # the geometry follows from mechanics


def load_fit(path: str | Path, *, own: Own = ()) -> Identification:
    """Load a saved fit as the result that `identify` returned, with its evidence.

    `validate`, `profile` and similar functions rebuild the problem from the file when they need it.

    Args:
        path: a `fit.json`.
        own: trusted modules and classes, such as `("my_rubber",)` or `(Gent,)`. A fit that names a class
            of any other module is refused, since importing that module would run its code.

    Returns:
        The fit. Enable float64 in JAX first, or the muscle's numbers are rounded to float32.

    Raises:
        InputError: the file is missing, damaged, not a fit or of an unknown schema, or it names a class
            that is not trusted.
    """
    path = check_path("a saved fit", path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path} is not a JSON file: {error}; {_WANTED}") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise InputError(f"{path} must be a fit of schema {SCHEMA!r}, got {schema!r}; {_WANTED}")
    try:
        return _identification(document, own)
    except NotTrustedError as error:
        raise NotTrustedError(f"{path}: {error}") from None
    except KeyError as error:
        raise InputError(f"{path} is damaged: entry {error} is missing; {_WANTED}") from None
    except (InputError, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{path} is damaged: {error}; {_WANTED}") from None


def _identification(document: Mapping[str, Any], own: Own) -> Identification:
    data, mounted = _data(document["data"]), _mounted(document, own)
    muscle, pressures = mounted.muscle, document["node_pressures_Pa"]
    coefficients = np.atleast_2d(_array(document["coefficients_Pa"]))
    estimates = tuple(_estimate(name, one) for name, one in document["parameters"].items())
    nodes, first = (), len(estimates) - coefficients.size
    if pressures is not None:
        at_nodes = [
            dataclasses.replace(one, name=one.name.rpartition("_at_")[0])
            for one in estimates[first:]
        ]
        nodes = tuple(zip(*[iter(at_nodes)] * coefficients.shape[1], strict=True))
    stderr = np.array([one.stderr for one in estimates[first:]]).reshape(coefficients.shape)
    assert isinstance(muscle, famjax.Muscle | famjax.EquilibriumMuscle)
    law = Law(muscle.material)
    if pressures is not None:
        law = law_named("polynomial", coefficients.shape[1])
    elif isinstance(muscle, famjax.EquilibriumMuscle):
        ends = {one.name: (one.min, one.max) for one in estimates}
        law = SearchedLaw(muscle.material, tuple((name, *ends[name]) for name in law.coefficients))
    pictures = document["photographs"]
    known = {
        name: document[name]
        for name in ("strain_range", "constraint", "dependence", "seed", "converged",
                     "degrees_of_freedom")
    }  # fmt: skip
    return Identification(
        data=data,
        mounted=mounted,
        estimates=estimates if pressures is None else estimates[:first],
        node_estimates=nodes,
        derived=tuple(_estimate(name, one) for name, one in document["derived"].items()),
        coefficients=coefficients,
        coefficients_stderr=stderr,
        node_pressures=None if pressures is None else _array(pressures),
        residuals=_array(document["residuals_N"]),
        errors=Errors(**_figures(document, _ERRORS)),
        certificate=Certificate(**_figures(document, _CERTIFICATE)),
        active_constraints=tuple(_sentence(one) for one in document["active_constraints"]),
        law=law,
        weights=_array(document["weights"]),
        names=tuple(document["covariance"]["parameters"])[: -coefficients.size or None],
        covariance=_array(document["covariance"]["matrix"]),
        place=0,
        solved=functools.partial(_opened, document, own),
        pictures=pictures and PictureFit.from_dict(pictures),
        outlook=_outlook(document, mounted, own),
        document=document,
        **known,
    )


def _opened(document: Mapping[str, Any], own: Own) -> Solved:
    """Rebuild the problem from a saved fit; its optimum is the only start.

    Raises:
        InputError: several specimens were identified together, or a part cannot be restored from a file.
    """
    fit, asked = _identification(document, own), document["posed"]
    if asked is None:
        raise InputError(
            "this fit cannot be restored from its file: it belongs to several specimens, or its geometry "
            "is built by a function. Repeat the identification"
        )
    geometry, terms = asked["geometry"], asked["terms"]
    if geometry is not None and ":" in geometry:
        check_trusted(geometry, own, "geometry")
    own_terms = getattr(getattr(fit.muscle, "terms", None), "terms", ())[-terms:] if terms else ()
    entries = (*fit.estimates, *(fit.node_estimates[0] if fit.node_estimates else ()))
    posed = pose(
        (dataclasses.replace(fit.data, force_std=None),),
        law=fit.law, constraint=fit.constraint, noise=asked["noise"],
        parameters={one.name: _said(one) for one in entries}, censored=asked["censored"],
        geometry=_geometry(fit, geometry),
        terms=famjax.terms.SumOfTerms(own_terms) if terms else None,
    )  # fmt: skip
    (part,) = posed.problem.parts
    problem = dataclasses.replace(
        posed.problem,
        parts=(dataclasses.replace(part, weight=_array(asked["reading_weights"])),),
        priors=posed.problem.priors + (fit.pictures.priors if fit.pictures else ()),
    )
    values = np.array([fit.estimate(name).value for name in problem.names])
    low, high = problem.low[problem.free], problem.high[problem.free]
    end = descend(problem, np.clip((values[problem.free] - low) / (high - low), 0.0, 1.0))
    best, problem = refine(problem, best_of([end]), EXCHANGES)
    return Solved(problem, best)


def _geometry(fit: Identification, said: str | None) -> Any:
    """Return the geometry named in a file as an argument of `pose`."""
    if said == _MECHANICS:
        return EquilibriumSource(fit.data.specimen)
    return getattr(fit.muscle, "geometry", None) if said == _KNOWN else said


def _said(one: Estimate) -> Parameter:
    """Return the specification of a parameter in SI."""
    unit = si_unit(one.kind)
    if one.fixed:
        return Parameter(value=one.value, vary=False, unit=unit)
    low, high = (end if math.isfinite(end) else None for end in (one.min, one.max))
    return Parameter(min=low, max=high, prior=one.prior, unit=unit)


def _posed(result: Identification) -> dict[str, Any] | None:
    """Return what `_opened` needs in addition to the estimates; None if a file cannot store it."""
    problem = result.problem
    family = problem.parts[result.place].family
    if len(problem.parts) > 1:
        return None
    source, geometry = family.source, None
    if isinstance(source, WrappedSource) and isinstance(source.wrap, type):
        geometry = class_path(source.wrap)
    elif isinstance(source, KnownSource):
        geometry = _KNOWN
    elif isinstance(source, EquilibriumSource):
        geometry = _MECHANICS
    elif not isinstance(source, EstimatedSource):
        return None
    return {
        "geometry": geometry,
        "terms": 0 if family.terms is None else len(family.terms.terms),
        "censored": bool((problem.side != 0).any()),
        "noise": problem.noise,
        "reading_weights": problem.weight.tolist(),
    }


def _array(values: Any) -> np.ndarray:
    """Convert a list to floats; null becomes nan."""
    return np.array(values, float)


def _figures(document: Mapping[str, Any], keys: Mapping[str, str]) -> dict[str, Any]:
    found = {name: document[key] for name, key in keys.items()}
    return {name: math.nan if value is None else value for name, value in found.items()}


def _written(part: Errors | Certificate, keys: Mapping[str, str]) -> dict[str, Any]:
    found = {key: getattr(part, name) for name, key in keys.items()}
    return {k: v if isinstance(v, int) else finite_or_none(v) for k, v in found.items()}


def _data(saved: Mapping[str, Any]) -> ForceData:
    columns = {name.rpartition("_")[0]: _array(v) for name, v in saved["readings"].items()}
    specimen = {name.removesuffix("_m"): value for name, value in saved["specimen"].items()}
    said: dict[str, Any] = {name: saved[name] for name in _SAID}
    said = {name: _array(one) if isinstance(one, list) else one for name, one in said.items()}
    return ForceData(
        **columns, **said, specimen=Specimen(**specimen),
        notes=tuple(map(_sentence, saved["notes"])), assumed=tuple(saved["assumed"]),
    )  # fmt: skip


def _parts(sentence: str) -> Any:
    """Convert a sentence to JSON; its quantities are kept."""
    if isinstance(sentence, Sentence):
        return [_parts(one) if isinstance(one, str) else one._asdict() for one in sentence.parts]
    return sentence


def _sentence(parts: Any) -> str:
    if isinstance(parts, str):
        return parts
    return Sentence(
        *(Quantity(**one) if isinstance(one, dict) else _sentence(one) for one in parts)
    )


def _mounted(entry: Mapping[str, Any], own: Own) -> famjax.MountedMuscle:
    """Restore a muscle with its rig."""
    exponent = entry.get("series_exponent")
    return famjax.MountedMuscle(
        muscle_from_dict(entry["muscle"], own=own),
        float(entry["series_compliance_m_per_N"]),
        None if exponent is None else float(exponent),
    )


def _outlook(document: Mapping[str, Any], mounted: famjax.MountedMuscle, own: Own) -> Outlook:
    """Restore the data for predictions.

    Raises:
        ValueError: the directions do not fit the muscle's parameters.
    """
    averaged, spread = document["averaged_with"], document["spread"]
    weights = [float(one["weight"]) for one in averaged]
    error, slip, elsewhere = (
        document.get(name) for name in ("model_error", "hysteresis", "other_lengths")
    )
    count = sum(map(np.size, jax.tree.leaves(eqx.filter(mounted, eqx.is_inexact_array))))
    directions, shared = (
        _array(spread[name]).reshape(-1, count) for name in ("directions", "shared_directions")
    )
    missed = [] if slip is None else [one["rms_N"] for one in slip["left_out"].values()]
    return Outlook(
        error=None if error is None else ModelError.from_dict(error),
        directions=directions,
        bootstrap=spread["band"] == "bootstrap",
        shared=shared,
        others=tuple(_mounted(one, own) for one in averaged),
        weights=(1.0 - sum(weights), *weights),
        alike={one["family"]: _mounted(one, own) for one in document["alike"]},
        other_lengths={
            one["family"]: _mounted(one, own) for one in (elsewhere or {}).get("members", ())
        },
        between=math.nan if elsewhere is None else elsewhere["between_N"],
        hysteresis=None if slip is None else slip_from_dict(slip),
        branches_error=math.nan if slip is None else max(missed, default=slip["rms_N"]),
        series=document.get("series"),
    )


def estimate_as_dict(estimate: Estimate, system: str) -> dict[str, Any]:
    """Return an estimate in a unit system, ready for JSON."""
    unit = unit_system(system)[estimate.kind]

    def scaled(value: float) -> float | None:
        return finite_or_none(from_si(value, unit, estimate.kind))

    numbers = {name: scaled(getattr(estimate, name)) for name in _NUMBERS}
    prior = None if estimate.prior is None else [scaled(v) for v in estimate.prior]
    return {
        "unit": unit, "kind": estimate.kind, **numbers, "at_bound": estimate.at_bound,
        "fixed": estimate.fixed, "prior": prior,
    }  # fmt: skip


_NUMBERS = {
    "value": math.nan, "stderr": math.nan, "sandwich_stderr": math.nan, "min": -math.inf, "max": math.inf,
}  # fmt: skip
"""Numbers of an estimate, and the value of null."""


def _estimate(name: str, saved: Mapping[str, Any]) -> Estimate:
    numbers = {key: none if saved[key] is None else saved[key] for key, none in _NUMBERS.items()}
    prior = None if saved["prior"] is None else tuple(saved["prior"])
    said = {key: saved[key] for key in ("at_bound", "fixed", "kind")}
    return Estimate(name, prior=prior, **numbers, **said)


def summary_as_dict(
    result: Identification,
    system: str = "si",
    evidence: Evidence | None = None,
    *,
    choice: Choice | None = None,
    judgement: Judgement | None = None,
) -> dict[str, Any]:
    """Return the results of a fit as a flat JSON object: parameters in the unit system, the rest in SI."""
    judged, asked = judge(result) if judgement is None else judgement, _known(result, evidence)
    fixed = result.node_pressures is None
    warnings = (*result.warnings, *evidence_warnings(asked, result))
    return {
        "verdict": judged.level,
        "reasons": [str(sentence_in_units(one, system)) for one in judged.reasons],
        "unchecked": str(sentence_in_units(judged.unchecked, system)) or None,
        "suspicions": [one.cause for one in judged.suspicions],
        "choice": None if choice is None else choice_as_dict(choice),
        **_written(result.errors, _ERRORS),
        "rmse_percent": finite_or_none(result.errors.rmse_percent),
        "parameters": {e.name: estimate_as_dict(e, system) for e in result.all_estimates},
        "derived": {e.name: estimate_as_dict(e, system) for e in result.derived},
        "coefficients_Pa": (result.coefficients[0] if fixed else result.coefficients).tolist(),
        "node_pressures_Pa": None if fixed else np.asarray(result.node_pressures).tolist(),
        "strain_range": result.strain_range,
        **_written(result.certificate, _CERTIFICATE),
        "law": result.law.name,
        "order": result.order,
        "n_parameters": result.n_parameters,
        **_rig(result.mounted),
        "constraint": result.constraint,
        "dependence": result.dependence,
        "active_constraints": list(result.active_constraints),
        "converged": result.converged,
        "warnings": [str(sentence_in_units(one, system)) for one in warnings],
        **evidence_as_dict(asked),
    }


def _known(result: Identification, evidence: Evidence | None) -> Evidence:
    """Return the evidence, or else what the choice of the family found."""
    return evidence or Evidence(error=result.outlook.error)


_PACKAGES = ("jax", "jaxlib", "equinox", "optimistix", "numpy")


def versions() -> dict[str, str]:
    """Return the versions of famjax, Python and the numerical packages."""
    packages = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return {"famjax": famjax.__version__, "python": platform.python_version(), **packages}


def correlations(result: Identification) -> tuple[tuple[str, ...], Float[np.ndarray, "k k"]]:
    """Return names and correlations of the identified parameters from linear theory.

    Parameters that are fixed, at a bound or not identifiable have no standard error and are left out.
    """
    names = result.names + result.coefficient_names
    variance = np.diag(result.covariance)
    known = np.flatnonzero(np.isfinite(variance) & (variance > 0))
    scale = np.sqrt(variance[known])
    matrix = result.covariance[np.ix_(known, known)] / np.outer(scale, scale)
    return tuple(names[k] for k in known), matrix


def fit_as_dict(
    result: Identification,
    evidence: Evidence | None = None,
    origin: Origin | None = None,
    *,
    choice: Choice | None = None,
    judgement: Judgement | None = None,
) -> dict[str, Any]:
    """Return the content of `fit.json` in SI.

    Args:
        result: result of `identify`.
        evidence: validation and uncertainty, if available.
        origin: date and command to record, if any.
        choice: choice that the result comes from, if any.
        judgement: the verdict; default: derived from the fit.
    """
    names, matrix = correlations(result)
    data, asked, outlook = result.data, _known(result, evidence), result.outlook
    drawn, shared = asked.bootstrap, () if asked.shared is None else asked.shared.directions
    others, known = outlook.other_lengths, dataclasses.asdict(data.specimen)
    return {
        "schema": SCHEMA,
        "versions": versions(),
        "origin": None if origin is None else origin.as_dict(),
        "data": {
            "sha256": data.sha256,
            "specimen": {f"{k}_m" if k in SPECIMEN_LENGTHS else k: v for k, v in known.items()},
            "readings": {name: values.tolist() for name, values in data.columns().items()},
            "notes": [_parts(one) for one in data.notes],
            "assumed": list(data.assumed),
            **{n: v.tolist() if isinstance(v := getattr(data, n), np.ndarray) else v for n in _SAID},
        },
        "posed": result.document.get("posed") or _posed(result),
        "photographs": None if result.pictures is None else result.pictures.as_dict(),
        "seed": result.seed,
        "spread": {
            "band": "linear" if drawn is None else "bootstrap",
            "directions": muscle_spread(result, drawn).tolist(),
            # Six digits: a measured shape may have thousands of numbers.
            "shared_directions": [[float(f"{value:.6g}") for value in row] for row in shared],
        },
        **summary_as_dict(result, evidence=asked, choice=choice, judgement=judgement),
        "averaged_with": [],
        "alike": _in_rigs(outlook.alike.values(), family=list(outlook.alike)),
        "other_lengths": {
            "between_N": outlook.between,
            "members": _in_rigs(others.values(), family=list(others)),
        } if others else None,
        "correlations": {"parameters": list(names), "matrix": [_finite(row) for row in matrix]},
        "covariance": {
            "parameters": [*result.names, *result.coefficient_names],
            "matrix": [_finite(row) for row in result.covariance],
        },
        "degrees_of_freedom": result.degrees_of_freedom,
        "active_constraints": [_parts(one) for one in result.active_constraints],
        "residuals_N": result.residuals.tolist(),
        "weights": result.weights.tolist(),
        "muscle": muscle_as_dict(result.muscle),
    }  # fmt: skip


def _finite(values: Iterable[float]) -> list[float | None]:
    return [finite_or_none(value) for value in values]


def _rig(mounted: famjax.MountedMuscle) -> dict[str, Any]:
    """Return the entries of a rig; a linear one has no exponent."""
    compliance = {"series_compliance_m_per_N": float(mounted.compliance)}
    exponent = mounted.exponent
    return compliance if exponent is None else {**compliance, "series_exponent": float(exponent)}


def _in_rigs(
    muscles: Iterable[famjax.MountedMuscle], **about: Sequence[Any]
) -> list[dict[str, Any]]:
    """Return the entries of muscles with their rigs; `about` has one further value per muscle."""
    return [
        {**dict(zip(about, said, strict=True)), **_rig(one), "muscle": muscle_as_dict(one.muscle)}
        for one, *said in zip(muscles, *about.values(), strict=True)
    ]


def series_as_dict(series: Series, origin: Origin | None = None) -> dict[str, Any]:
    """Return the `fit.json` of a series: the one of its first specimen, with entries for the others."""
    data, others = [one.data for one in series.specimens], [one[0] for one in series.others]
    judged = judge_series(series.specimens, series.left_out)
    ratios = np.concatenate([one.length / one.specimen.rest_length for one in data])
    pressures = np.concatenate([one.pressure for one in data])
    predicted = series.left_out.group_rmse
    return {
        **fit_as_dict(series.specimens[0], origin=origin, judgement=judged),
        "averaged_with": _in_rigs(
            [one.mounted for one in others],
            weight=series.weights[1:],
            law=[one.law.name for one in others],
        ),
        "series": {
            "law": series.law,
            "family": series.name,
            "averaged": 1 + len(series.others),
            "between_N": series.between,
            "predicted_rmse_N": series.left_out.rmse,
            "leave_one_specimen_out_N": {
                law: finite_or_none(error) for law, error in series.candidates.items()
            },
            "specimens": [
                {
                    "name": one.data.specimen.name,
                    "rest_length_m": one.data.specimen.rest_length,
                    "source": one.data.source,
                    "sha256": one.data.sha256,
                    "rmse_N": one.errors.rmse,
                    "predicted_rmse_N": float(error),
                    "max_force_N": one.errors.max_force,
                }
                for one, error in zip(series.specimens, predicted, strict=True)
            ],
            "rest_lengths_m": [one.specimen.rest_length for one in data],
            "length_ratios": [float(ratios.min()), float(ratios.max())],
            "pressures_Pa": [float(pressures.min()), float(pressures.max())],
        },
    }


def card_of(
    fit: Identification, *, name: str | None = None, count: int = 32, seed: int = 0,
    origin: Origin | None = None,
) -> MuscleCard:  # fmt: skip
    """Make the card of a fitted muscle.

    The card's force is the force measured in the rig of the fit; for a series, the weighted mean over its
    models.

    Args:
        fit: result of `load_fit` or `identify`.
        name: name of the muscle; default: that of the specimen.
        count: number of sampled muscles; a fit without standard errors has none.
        seed: seed of the sample.
        origin: date and command of the card, in addition to those of the fit.

    Raises:
        InputError: the model is nowhere monotone, or too few muscles can be drawn.
    """
    document, outlook = fit.document or fit_as_dict(fit), fit.outlook
    if count < 0:
        raise InputError(f"count, the number of sampled muscles, must be >= 0, got {count}")
    data = fit.data
    card = MuscleCard(
        name=name or data.specimen.name or "unnamed",
        members=(fit.mounted, *outlook.others),
        weights=np.array(outlook.weights),
        data=Region.of(data.length, data.pressure),
        covariance=_covariance(document),
        draws=None,
        hysteresis=outlook.hysteresis,
        provenance=_provenance(document, origin, [_NOT_ITS_VOLUME] * bool(equivalent_sizes(fit))),
    )
    directions = np.array(document["spread"]["directions"])
    if not (directions.size and count):
        return card
    drawn = draw(card.members, card.weights, directions, card.region, seed=seed, count=count)
    return dataclasses.replace(card, draws=drawn)


def _covariance(document: Mapping[str, Any]) -> Covariance | None:
    """Covariance of the identified parameters, relative to their values."""
    names, matrix = (document["correlations"][key] for key in ("parameters", "matrix"))
    if not names:
        return None
    estimates = [document["parameters"][name] for name in names]
    values, stderr = (np.array([one[key] for one in estimates]) for key in ("value", "stderr"))
    scales = np.where(values == 0, 1.0, np.abs(values))
    spread = np.array(matrix, float) * np.outer(stderr / scales, stderr / scales)
    units = [one["unit"] for one in estimates]
    return Covariance(names, units, values.tolist(), scales.tolist(), spread.tolist())


_NOT_ITS_VOLUME = (
    "the geometry is an equivalent cylinder: its volume changes are those of the muscle, but its "
    "absolute volume is not"
)


def _provenance(document: Mapping[str, Any], origin: Origin | None, notes: list[str]) -> Provenance:
    data, made = document["data"], document.get("origin") or {}
    here = {} if origin is None else origin.as_dict()
    commands = [one["command"] for one in (made, here) if one.get("command")]
    return Provenance(
        verdict=document["verdict"],
        reasons=document["reasons"],
        rmse_N=document["rmse_N"],
        max_error_N=document["max_error_N"],
        max_force_N=document["max_force_N"],
        model_error=document.get("model_error"),
        source=data["source"],
        data_sha256=data["sha256"],
        specimen={k: v for k, v in data["specimen"].items() if v is not None},
        date=here.get("date", made.get("date")),
        command=" && ".join(commands) or None,
        versions=document["versions"],
        notes=notes,
    )
