"""Write a fit to `fit.json`, load it again, and create a muscle card from it."""

import dataclasses
import functools
import importlib.metadata
import json
import math
import platform
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import msgspec
import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError, NotTrustedError, Own
from famjax.boundary.files import Origin
from famjax.boundary.units import si_unit
from famjax.cards import (
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
from .families import EstimatedSource, KnownSource, Law
from .mechanics import EquilibriumSource, SearchedLaw
from .parameters import Parameter
from .pictured import PictureFit
from .posing import EXCHANGES, pose
from .result import Certificate, Errors, Estimate, Identification, Outlook, Solved, equivalent_sizes
from .search import best_of, descend, refine
from .series import Series
from .verdict import Judgement, judge, judge_series

SCHEMA = "famjax-fit/2"
_WANTED = "choose a fit.json written by famjax fit"

_ERRORS = {
    "rmse": "rmse_N", "max": "max_error_N", "max_force": "max_force_N",
    "n_points": "n_points", "max_slack_force": "max_slack_force_N",
}  # fmt: skip
_CERTIFICATE = {
    "stability_margin": "stability_margin_Pa", "constraint_margin": "constraint_margin_Pa",
    "kkt_residual": "kkt_residual", "duality_gap": "duality_gap",
    "gradient_residual": "gradient_residual", "condition": "condition", "n_starts": "n_starts",
    "n_agreeing": "n_starts_agreeing", "shape_margin": "shape_margin_N_per_m",
}  # fmt: skip
"""Key in the file for each field."""
_PLAIN = ("strain_range", "constraint", "converged", "seed", "degrees_of_freedom")
_ARRAYS = {
    "coefficients": "coefficients_Pa", "residuals": "residuals_N", "weights": "weights",
    "covariance": "covariance",
}  # fmt: skip
"""Fields of a fit that are saved as they are, and keys of its arrays."""
_SAID = tuple(
    one.name for one in dataclasses.fields(ForceData) if one.name not in {*COLUMNS, "specimen"}
)
"""Fields of a map that are saved under their own names."""
_KNOWN = "known"  # the geometry is given, such as a measured one
_MECHANICS = "equilibrium"  # the geometry follows from mechanics


def load_fit(path: str | Path, *, own: Own = ()) -> Identification:
    """Load a saved fit in the form that `identify` returned, with its evidence.

    `validate`, `profile` and similar functions rebuild the problem from the file when they need it.

    Args:
        path: a `fit.json`.
        own: trusted modules and classes, such as `("my_rubber",)` or `(Gent,)`. A fit that refers to a
            class from any other module is rejected, because importing that module would run its code.

    Returns:
        The fit. Enable float64 in JAX first; otherwise the muscle's stored values are rounded to float32.

    Raises:
        InputError: the file is missing, damaged, not a fit, or has an unknown schema, or it refers to a
            class that is not trusted.
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
        raise InputError(f"{path} must be a fit with schema {SCHEMA!r}, got {schema!r}; {_WANTED}")
    try:
        return _identification(document, own)
    except NotTrustedError as error:
        raise NotTrustedError(f"{path}: {error}") from None
    except KeyError as error:
        raise InputError(f"{path} is damaged: entry {error} is missing; {_WANTED}") from None
    except (InputError, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{path} is damaged: {error}; {_WANTED}") from None


def _identification(document: Mapping[str, Any], own: Own) -> Identification:
    mounted, pictures = _mounted(document, own), document["photographs"]
    muscle: Any = mounted.muscle
    arrays = {name: _array(document[key]) for name, key in _ARRAYS.items()}
    estimates = tuple(map(_estimate, document["parameters"].values()))
    law = Law(muscle.material)
    if not isinstance(muscle, famjax.Muscle):
        ends = {one.name: (one.min, one.max) for one in estimates}
        law = SearchedLaw(muscle.material, tuple((name, *ends[name]) for name in law.coefficients))
    return Identification(
        data=_data(document["data"]),
        mounted=mounted,
        estimates=estimates,
        derived=tuple(map(_estimate, document["derived"].values())),
        errors=Errors(**_figures(document, _ERRORS)),
        certificate=Certificate(**_figures(document, _CERTIFICATE)),
        active_constraints=tuple(document["active_constraints"]),
        law=law,
        names=tuple(document["names"]),
        place=0,
        solved=functools.partial(_opened, document, own),
        pictures=pictures and PictureFit.from_dict(pictures),
        outlook=_outlook(document, mounted, own),
        document=document,
        **arrays,
        **{name: document[name] for name in _PLAIN},
    )


def _opened(document: Mapping[str, Any], own: Own) -> Solved:
    """Rebuild the problem of a saved fit, with its optimum as the only start.

    Raises:
        InputError: several specimens were identified together, or a part cannot be restored from a file.
    """
    fit, asked = _identification(document, own), document["posed"]
    if asked is None:
        raise InputError(
            "this fit cannot be restored from its file: it is shared by several specimens, or has a custom "
            "geometry or custom terms. Repeat the identification, or use famjax assess"
        )
    geometry = EquilibriumSource(fit.data.specimen) if asked["geometry"] == _MECHANICS else None
    if asked["geometry"] == _KNOWN:
        geometry = getattr(fit.muscle, "geometry", None)
    posed = pose(
        (dataclasses.replace(fit.data, force_std=None),),
        law=fit.law, constraint=fit.constraint, noise=asked["noise"],
        parameters={one.name: _said(one) for one in fit.estimates},
        censored=asked["censored"],
        geometry=geometry,
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


def _said(one: Estimate) -> Parameter:
    """Return the bounds and prior of an estimate as user settings in SI units."""
    low, high = (end if math.isfinite(end) else None for end in (one.min, one.max))
    return Parameter(min=low, max=high, prior=one.prior, unit=si_unit(one.kind))


def _posed(result: Identification) -> dict[str, Any] | None:
    """Return what `_opened` needs in addition to the estimates; None if a file cannot store it."""
    problem = result.problem
    family = problem.parts[result.place].family
    if len(problem.parts) > 1 or family.terms is not None:
        return None
    source, geometry = family.source, None
    if isinstance(source, KnownSource | EquilibriumSource):
        geometry = _KNOWN if isinstance(source, KnownSource) else _MECHANICS
    elif not isinstance(source, EstimatedSource):
        return None
    return {
        "geometry": geometry,
        "censored": bool((problem.side != 0).any()),
        "noise": problem.noise,
        "reading_weights": problem.weight,
    }


def _array(values: Any) -> Any:
    """Convert a list to floats, with nan for null; null alone stays None."""
    return None if values is None else np.array(values, float)


def as_json(value: Any) -> Any:
    """Convert to JSON-ready data: arrays become lists; nan and infinity become null."""
    text = msgspec.json.encode(
        value, enc_hook=lambda one: one.tolist() if hasattr(one, "tolist") else str(one)
    )
    return json.loads(text)


def _figures(document: Mapping[str, Any], keys: Mapping[str, str]) -> dict[str, Any]:
    found = {name: document[key] for name, key in keys.items()}
    return {name: math.nan if value is None else value for name, value in found.items()}


def _data(saved: Mapping[str, Any]) -> ForceData:
    columns = {name.rpartition("_")[0]: _array(v) for name, v in saved["readings"].items()}
    specimen = {name.removesuffix("_m"): value for name, value in saved["specimen"].items()}
    said = {name: saved[name] for name in _SAID}
    said |= {name: tuple(said[name]) for name in ("notes", "assumed")}
    said["count"] = _array(said["count"])
    return ForceData(**columns, specimen=Specimen(**specimen), **said)


def _mounted(entry: Mapping[str, Any], own: Own) -> famjax.MountedMuscle:
    """Restore a muscle with its rig."""
    rig = entry["series_compliance_m_per_N"], entry.get("series_exponent")
    return famjax.MountedMuscle(
        muscle_from_dict(entry["muscle"], own=own),
        *(None if one is None else float(one) for one in rig),
    )


def _outlook(document: Mapping[str, Any], mounted: famjax.MountedMuscle, own: Own) -> Outlook:
    """Restore the data for predictions.

    Raises:
        ValueError: the directions do not have as many entries as the muscle has parameters.
    """
    averaged, spread = document["averaged_with"], document["spread"]
    weights = [float(one["weight"]) for one in averaged]
    error, slip, elsewhere = map(document.get, ("model_error", "hysteresis", "other_lengths"))
    count = sum(map(np.size, jax.tree.leaves(eqx.filter(mounted, eqx.is_inexact_array))))
    directions, shared = (
        _array(spread[name]).reshape(-1, count) for name in ("directions", "shared_directions")
    )
    missed = [] if slip is None else [one["rms_N"] for one in slip["left_out"].values()]

    def by_family(members: Iterable[Mapping[str, Any]]) -> dict[str, famjax.MountedMuscle]:
        return {one["family"]: _mounted(one, own) for one in members}

    return Outlook(
        error=None if error is None else ModelError.from_dict(error),
        directions=directions,
        bootstrap=spread["band"] == "bootstrap",
        shared=shared,
        others=tuple(_mounted(one, own) for one in averaged),
        weights=(1.0 - sum(weights), *weights),
        alike=by_family(document["alike"]),
        other_lengths={} if elsewhere is None else by_family(elsewhere["members"]),
        between=math.nan if elsewhere is None else elsewhere["between_N"],
        hysteresis=None if slip is None else slip_from_dict(slip),
        branches_error=math.nan if slip is None else max(missed, default=slip["rms_N"]),
        series=document.get("series"),
    )


_NULLS = {"value": math.nan, "stderr": math.nan, "min": -math.inf, "max": math.inf}
"""Numbers of an estimate that may be null, and what null means."""


def _estimate(saved: Mapping[str, Any]) -> Estimate:
    found: dict[str, Any] = {key: value for key, value in saved.items() if key != "unit"}
    found |= {key: value for key, value in _NULLS.items() if saved[key] is None}
    return Estimate(**{**found, "prior": saved["prior"] and tuple(saved["prior"])})


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
        result: fit from `identify`.
        evidence: validation and uncertainty, if available.
        origin: date and command to record, if any.
        choice: the `Choice` that produced the result, if any.
        judgement: the verdict; default: derived from the fit.
    """
    data, errors, outlook = result.data, result.errors, result.outlook
    judged, asked = judgement or judge(result), evidence or Evidence(error=outlook.error)
    shared = () if asked.shared is None else asked.shared.directions
    others, known = outlook.other_lengths, dataclasses.asdict(data.specimen)

    def entries(estimates: Iterable[Estimate]) -> dict[str, Any]:
        return {
            one.name: {"unit": si_unit(one.kind), **dataclasses.asdict(one)} for one in estimates
        }

    return as_json({
        "schema": SCHEMA,
        "versions": versions(),
        "origin": None if origin is None else origin.as_dict(),
        "verdict": judged.level,
        "reasons": judged.reasons,
        "unchecked": judged.unchecked or None,
        "suspicions": [one.cause for one in judged.suspicions],
        "warnings": (*result.warnings, *evidence_warnings(asked, result)),
        "choice": None if choice is None else choice_as_dict(choice),
        **{key: getattr(errors, name) for name, key in _ERRORS.items()},
        "rmse_percent": errors.rmse_percent,
        "parameters": entries(result.estimates),
        "derived": entries(result.derived),
        **{name: getattr(result, name) for name in _PLAIN},
        **{key: getattr(result.certificate, name) for name, key in _CERTIFICATE.items()},
        "active_constraints": result.active_constraints,
        "law": result.law.name,
        "order": result.law.order,
        "names": result.names,
        **{key: getattr(result, name) for name, key in _ARRAYS.items()},
        "muscle": muscle_as_dict(result.muscle),
        **_rig(result.mounted),
        "data": {
            "sha256": data.sha256,
            "specimen": {f"{k}_m" if k in SPECIMEN_LENGTHS else k: v for k, v in known.items()},
            "readings": data.columns(),
            **{name: getattr(data, name) for name in _SAID},
        },
        "photographs": None if result.pictures is None else result.pictures.as_dict(),
        **evidence_as_dict(asked),
        "spread": {
            "band": "linear" if asked.bootstrap is None else "bootstrap",
            "directions": muscle_spread(result, asked.bootstrap),
            # Six digits: a measured shape may have thousands of numbers.
            "shared_directions": [[float(f"{value:.6g}") for value in row] for row in shared],
        },
        "averaged_with": [],
        "alike": _in_rigs("family", outlook.alike.items()),
        "other_lengths": {
            "between_N": outlook.between, "members": _in_rigs("family", others.items()),
        } if others else None,
        "posed": result.document.get("posed") or _posed(result),
    })  # fmt: skip


def _rig(mounted: famjax.MountedMuscle) -> dict[str, Any]:
    exponent = mounted.exponent
    return {
        "series_compliance_m_per_N": float(mounted.compliance),
        "series_exponent": None if exponent is None else float(exponent),
    }


def _in_rigs(key: str, muscles: Iterable[tuple[Any, famjax.MountedMuscle]]) -> list[dict[str, Any]]:
    """Return the entries of muscles with their rigs, each with one value under `key`."""
    return [{key: said, **_rig(one), "muscle": muscle_as_dict(one.muscle)} for said, one in muscles]


def series_as_dict(series: Series, origin: Origin | None = None) -> dict[str, Any]:
    """Return the `fit.json` of a series: that of its first specimen, plus entries for all specimens."""
    data, others = [one.data for one in series.specimens], [one[0].mounted for one in series.others]
    judged = judge_series(series.specimens, series.left_out)
    ratios = np.concatenate([one.length / one.specimen.rest_length for one in data])
    pressures = np.concatenate([one.pressure for one in data])
    return as_json({
        **fit_as_dict(series.specimens[0], origin=origin, judgement=judged),
        "averaged_with": _in_rigs("weight", zip(series.weights[1:], others, strict=True)),
        "series": {
            "family": series.name,
            "between_N": series.between,
            "predicted_rmse_N": series.left_out.rmse,
            "leave_one_specimen_out_N": series.candidates,
            "specimens": [
                {
                    "name": one.data.specimen.name,
                    "rest_length_m": one.data.specimen.rest_length,
                    "max_force_N": one.errors.max_force,
                    "rmse_N": one.errors.rmse,
                    "predicted_rmse_N": error,
                }
                for one, error in zip(series.specimens, series.left_out.group_rmse, strict=True)
            ],
            "rest_lengths_m": [one.specimen.rest_length for one in data],
            "length_ratios": (ratios.min(), ratios.max()),
            "pressures_Pa": (pressures.min(), pressures.max()),
        },
    })  # fmt: skip


def card_of(
    fit: Identification, *, name: str | None = None, count: int = 32, seed: int = 0,
    origin: Origin | None = None, rig: bool = True,
) -> MuscleCard:  # fmt: skip
    """Create the muscle card for a fitted muscle.

    The card's force is the force measured in the rig used for the fit, or that of the muscle alone; for a
    series, it is the weighted mean over its models.

    Args:
        fit: result of `load_fit` or `identify`.
        name: name of the muscle; default: that of the specimen.
        count: number of muscles sampled from the uncertainty; 0 for none. No muscles can be sampled from a
            fit without standard errors.
        seed: random seed for the sample.
        origin: date and command of the card, in addition to those of the fit.
        rig: False to leave out a compliant rig; there is then no sample.

    Raises:
        InputError: the model is not monotonic in any region, or too few muscles can be sampled.
    """
    document, outlook = fit.document or fit_as_dict(fit), fit.outlook
    data, members, rig = fit.data, (fit.mounted, *outlook.others), rig or fit.deflection == 0
    if not rig:
        members = tuple(famjax.MountedMuscle(one.muscle, 0.0) for one in members)
    card = MuscleCard(
        name=name or data.specimen.name or "unnamed",
        members=members,
        weights=np.array(outlook.weights),
        data=Region.of(data.length, data.pressure),
        hysteresis=outlook.hysteresis,
        provenance=_provenance(document, origin, _cautions(fit, rig=rig)),
    )
    directions = np.array(document["spread"]["directions"])
    if not rig or not directions.size or count <= 0:
        return card
    try:
        drawn = draw(card.members, card.weights, directions, card.region, seed=seed, count=count)
    except InputError as error:
        notes = [*card.provenance.notes, f"the card has no sample of muscles: {error}"]
        made = msgspec.structs.replace(card.provenance, notes=notes)
        return dataclasses.replace(card, provenance=made)
    return dataclasses.replace(card, draws=drawn)


def _cautions(fit: Identification, *, rig: bool) -> list[str]:
    """Return notes on the use of the muscle, for the card and everything made from it."""
    notes = []
    if equivalent_sizes(fit):
        notes.append(
            "the geometry is an equivalent cylinder: its volume changes are those of the muscle, but its "
            "absolute volume is not"
        )
    if fit.deflection > 0:
        deflects = f"deflects by {1e3 * fit.deflection:.3g} mm at the largest measured force"
        notes.append(
            f"the force includes a compliant test rig, which {deflects}; for use in another mounting, "
            "leave it out with famjax card --without-rig"
            if rig else
            f"the test rig, which {deflects}, is left out: the force is that of the muscle alone, so it "
            "differs from the readings"
        )  # fmt: skip
    return notes


def _provenance(document: Mapping[str, Any], origin: Origin | None, notes: list[str]) -> Provenance:
    data, made = document["data"], document.get("origin") or {}
    here = {} if origin is None else origin.as_dict()
    commands = [one["command"] for one in (made, here) if one.get("command")]
    same = ("verdict", "reasons", "rmse_N", "max_error_N", "max_force_N", "versions")
    return Provenance(
        **{name: document[name] for name in same},
        model_error=document.get("model_error"),
        source=data["source"],
        data_sha256=data["sha256"],
        specimen={k: v for k, v in data["specimen"].items() if v is not None},
        date=here.get("date", made.get("date")),
        command=" && ".join(commands) or None,
        notes=notes,
    )
