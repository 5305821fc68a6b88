"""`fit.json`: everything about a fit in one self-describing file, and the way back; the card of a fit."""

import dataclasses
import importlib.metadata
import json
import platform
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError, NotTrustedError, Own
from famjax.boundary.files import Origin
from famjax.boundary.units import finite_or_none, from_si, sentence_in_units, unit_system
from famjax.cards import (
    Covariance,
    MuscleCard,
    Provenance,
    Sample,
    draw,
    muscle_as_dict,
    muscle_from_dict,
    slip_from_dict,
)
from famjax.continuation import Region
from famjax.slip import CentredSlip

from .arguments import check_path
from .bands import ModelError, muscle_spread
from .choice import Choice, choice_as_dict
from .data import SPECIMEN_LENGTHS
from .evidence import Evidence, evidence_as_dict, evidence_warnings
from .result import Estimate, Identification
from .series import Series
from .verdict import Judgement, judge, judge_series

SCHEMA = "famjax-fit/1"
_WANTED = "give a fit.json that famjax fit has written"

_ALONG = {"scale_N": (), "freedom": ()}
_SHAPES: dict[str, dict[str, tuple[int | str, ...]]] = {
    "model_error": {
        **dict.fromkeys(("noise_N", "factor_95", "floor_N"), ()),
        **{f"length.{name}": shape for name, shape in {"levels_m": ("n",), **_ALONG}.items()},
        **{f"pressure.{name}": shape for name, shape in {"levels_Pa": ("n",), **_ALONG}.items()},
    },
    "hysteresis": {"rms_N": ()},
    "other_lengths": {"between_N": ()},
    "series": {
        "between_N": (), "rest_lengths_m": ("n",), "length_ratios": (2,), "pressures_Pa": (2,),
    },
}  # fmt: skip
"""Shapes of numbers that predictions are made of; a word stands for any size but 0."""


@dataclasses.dataclass(frozen=True, repr=False)
class SavedFit:
    """A fit read back from `fit.json`.

    Attributes:
        mounted: the identified muscle, bit for bit, in the rig of the fit.
        document: the whole file as plain data, SI.
        hysteresis: about the muscle's force, or None where it was not identified.
        others: further muscles, in their rigs; a prediction is the weighted mean of the muscle and them.
        weights: of the muscle and of them.
        error: of predictions, or None where nothing was left out.
        other_lengths: muscles, in their rigs, of whose forces the mean is that of a muscle of another
            length; none where the fit cannot tell.
        alike: muscles, in their rigs, of other families that fit the readings alike; what they disagree
            about is in the band.
    """

    mounted: famjax.MountedMuscle
    document: dict[str, Any]
    hysteresis: CentredSlip | None = None
    others: tuple[famjax.MountedMuscle, ...] = ()
    weights: tuple[float, ...] = (1.0,)
    error: ModelError | None = None
    other_lengths: tuple[famjax.MountedMuscle, ...] = ()
    alike: tuple[famjax.MountedMuscle, ...] = ()

    @property
    def muscle(self) -> famjax.Muscle:
        """The identified muscle, bit for bit."""
        muscle = self.mounted.muscle
        assert isinstance(muscle, famjax.Muscle)
        return muscle

    @property
    def readings(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Length [m], pressure [Pa] and force [N] of the map that was fitted."""
        columns = self.document["data"]["readings"]
        length, pressure, force = (
            np.asarray(columns[name], float) for name in ("length_m", "pressure_Pa", "force_N")
        )
        return length, pressure, force

    @property
    def spread(self) -> dict[str, Any]:
        """In which directions the muscle's numbers vary, by name; empty where it is not known."""
        return self.document.get("spread") or {}

    def __repr__(self) -> str:
        name = self.document.get("data", {}).get("specimen", {}).get("name", "unnamed")
        return f"SavedFit({name}: law {self.document.get('law')}, RMSE {self.document.get('rmse_N')} N)"


def load_fit(path: str | Path, *, own: Own = ()) -> SavedFit:
    """The muscle and the figures of a saved fit.

    Args:
        path: a `fit.json`.
        own: modules and classes that are trusted, such as `("my_rubber",)` or `(Gent,)`. A fit that names
            a class of another module than these is refused: importing it would run its code.

    Returns:
        The fit. Enable float64 in JAX first, or the muscle's numbers are rounded to float32.

    Raises:
        InputError: no such file, not a fit of this program, of a schema it does not know, one that
            lacks what predictions are made of, or one with a class that is not trusted.
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
        return _saved_fit(document, own)
    except NotTrustedError as error:
        raise NotTrustedError(f"{path}: {error}") from None
    except InputError as error:
        raise InputError(f"{path} is damaged: {error}") from None


def _saved_fit(document: dict[str, Any], own: Own) -> SavedFit:
    mounted = _mounted(document, own)
    _check(document, mounted)
    averaged = document.get("averaged_with") or ()
    weights = [float(_entry(one, "weight")) for one in averaged]
    elsewhere = (document.get("other_lengths") or {}).get("members", ())
    slip, error = document.get("hysteresis"), document.get("model_error")
    return SavedFit(
        mounted,
        document,
        hysteresis=None if slip is None else slip_from_dict(slip),
        others=tuple(_mounted(one, own) for one in averaged),
        weights=(1.0 - sum(weights), *weights),
        error=None if error is None else ModelError.from_dict(error),
        other_lengths=tuple(_mounted(one, own) for one in elsewhere),
        alike=tuple(_mounted(one, own) for one in document.get("alike") or ()),
    )


def _mounted(entry: Any, own: Own) -> famjax.MountedMuscle:
    """A muscle in its rig, from its entry."""
    card = _entry(entry, "muscle")
    if not isinstance(card, dict):
        raise InputError(f"'muscle' must be an object in braces, got {card!r}")
    for name in ("series_compliance_m_per_N", "series_exponent"):
        if entry.get(name) is not None:
            _numbers(entry, name, ())
    return famjax.MountedMuscle(
        muscle_from_dict(card, own=own),
        _entry(entry, "series_compliance_m_per_N") or 0.0,
        entry.get("series_exponent"),
    )


def _entry(document: Any, path: str) -> Any:
    """What stands at dotted keys."""
    found = document
    for key in path.split("."):
        if not isinstance(found, dict) or key not in found:
            raise InputError(f"it has no entry {path!r}; write it anew with famjax fit")
        found = found[key]
    return found


def _check(document: dict[str, Any], mounted: famjax.MountedMuscle) -> None:
    """Raise unless what predictions are made of is there, finite and of its shape."""
    for column in ("length_m", "pressure_Pa", "force_N"):
        _numbers(document, f"data.readings.{column}", ("n",))
    for part, shapes in _SHAPES.items():
        if document.get(part) is not None:
            for name, shape in shapes.items():
                _numbers(document, f"{part}.{name}", shape)
    if document.get("spread") is not None:
        count = sum(map(np.size, jax.tree.leaves(eqx.filter(mounted, eqx.is_inexact_array))))
        for name in ("directions", "shared_directions"):
            if _entry(document, f"spread.{name}") != []:
                _numbers(document, f"spread.{name}", ("directions", count))
    if document.get("hysteresis") is not None:
        for kind in _entry(document, "hysteresis.left_out"):
            _numbers(document, f"hysteresis.left_out.{kind}.rms_N", ())
    if document.get("other_lengths") is not None:
        _entry(document, "other_lengths.members")


def _numbers(document: dict[str, Any], path: str, shape: tuple[int | str, ...]) -> None:
    """Raise unless finite numbers of a shape stand there; a word stands for any size but 0."""
    found = _entry(document, path)
    try:
        numbers = np.asarray(found)
    except ValueError:  # lists of unequal lengths
        numbers = np.asarray(None)
    sizes = zip(numbers.shape, shape, strict=False)
    if (
        numbers.dtype.kind not in "fi"
        or numbers.ndim != len(shape)
        or not all(size and (isinstance(want, str) or size == want) for size, want in sizes)
        or not np.isfinite(numbers).all()
    ):
        wanted = ", ".join(map(str, shape))
        raise InputError(
            f"{path!r} must hold finite numbers of shape ({wanted}), got shape {numbers.shape}; "
            "write it anew with famjax fit"
        )


_PACKAGES = ("jax", "jaxlib", "equinox", "optimistix", "numpy")


def estimate_as_dict(estimate: Estimate, system: str) -> dict[str, Any]:
    """One estimate in a unit system, ready for JSON."""
    unit = unit_system(system)[estimate.kind]

    def scaled(value: float) -> float | None:
        return finite_or_none(from_si(value, unit, estimate.kind))

    return {
        "value": scaled(estimate.value),
        "unit": unit,
        "stderr": scaled(estimate.stderr),
        "sandwich_stderr": scaled(estimate.sandwich_stderr),
        "at_bound": estimate.at_bound,
        "min": scaled(estimate.min),
        "max": scaled(estimate.max),
        "fixed": estimate.fixed,
        "prior": None if estimate.prior is None else [scaled(v) for v in estimate.prior],
    }


def summary_as_dict(
    result: Identification,
    system: str = "si",
    evidence: Evidence | None = None,
    *,
    choice: Choice | None = None,
    judgement: Judgement | None = None,
) -> dict[str, Any]:
    """The figures of a fit as one flat JSON object; parameters in the unit system, the rest SI."""
    judged = judge(result) if judgement is None else judgement
    errors, certificate = result.errors, result.certificate
    fixed = result.node_pressures is None
    return {
        "verdict": judged.level,
        "reasons": [str(sentence_in_units(one, system)) for one in judged.reasons],
        "unchecked": str(sentence_in_units(judged.unchecked, system)) or None,
        "suspicions": [one.cause for one in judged.suspicions],
        "choice": None if choice is None else choice_as_dict(choice),
        "rmse_N": finite_or_none(errors.rmse),
        "mae_N": finite_or_none(errors.mae),
        "max_error_N": finite_or_none(errors.max),
        "max_force_N": errors.max_force,
        "rmse_percent": finite_or_none(errors.rmse_percent),
        "n_points": errors.n_points,
        "n_slack": errors.n_slack,
        "slack_violations": errors.slack_violations,
        "max_slack_force_N": finite_or_none(errors.max_slack_force),
        "parameters": {e.name: estimate_as_dict(e, system) for e in result.all_estimates},
        "derived": {e.name: estimate_as_dict(e, system) for e in result.derived},
        "coefficients_Pa": (result.coefficients[0] if fixed else result.coefficients).tolist(),
        "node_pressures_Pa": None if fixed else np.asarray(result.node_pressures).tolist(),
        "strain_range": result.strain_range,
        "stability_margin_Pa": finite_or_none(certificate.stability_margin),
        "slope_margin_Pa": finite_or_none(certificate.slope_margin),
        "constraint_margin_Pa": finite_or_none(certificate.constraint_margin),
        "kkt_residual": finite_or_none(certificate.kkt_residual),
        "duality_gap": finite_or_none(certificate.duality_gap),
        "gradient_residual": finite_or_none(certificate.gradient_residual),
        "condition": finite_or_none(certificate.condition),
        "n_starts": certificate.n_starts,
        "n_starts_agreeing": certificate.n_agreeing,
        "law": result.law.name,
        "order": result.order,
        "n_parameters": result.n_parameters,
        **_rig(result.mounted),
        "constraint": result.constraint,
        "dependence": result.dependence,
        "active_constraints": list(result.active_constraints),
        "converged": result.converged,
        "warnings": [
            str(sentence_in_units(one, system))
            for one in (*result.warnings, *evidence_warnings(evidence or Evidence(), result))
        ],
        **evidence_as_dict(evidence or Evidence()),
    }


def versions() -> dict[str, str]:
    """Versions of the program and of what its numbers depend on."""
    packages = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return {"famjax": famjax.__version__, "python": platform.python_version(), **packages}


def correlations(
    result: Identification,
) -> tuple[tuple[str, ...], Float[np.ndarray, "k k"]]:
    """Names and correlations of what the data determine, by linear theory.

    What is held, at a bound or not identifiable has no standard error and is left out.
    """
    names = result.problem.names + result.coefficient_names
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
    """The whole content of `fit.json`, in SI.

    Args:
        result: what `identify` returned.
        evidence: validation and uncertainty, if there are any.
        origin: date and command, if the file is to say them.
        choice: of which the result is the chosen family, where it was chosen.
        judgement: the verdict; found from the fit alone unless given.
    """
    names, matrix = correlations(result)
    data, asked = result.data, evidence or Evidence()
    specimen = {
        f"{key}_m" if key in SPECIMEN_LENGTHS else key: value
        for key, value in dataclasses.asdict(data.specimen).items()
    }
    others = None if choice is None else choice.other_lengths
    return {
        "schema": SCHEMA,
        "versions": versions(),
        "origin": None if origin is None else origin.as_dict(),
        "data": {
            "source": data.source,
            "sha256": data.sha256,
            "specimen": specimen,
            "readings": {name: values.tolist() for name, values in data.columns().items()},
        },
        "seed": result.seed,
        "spread": _spread(result, asked),
        **summary_as_dict(result, evidence=asked, choice=choice, judgement=judgement),
        "averaged_with": [],
        "alike": (
            [] if choice is None else _in_rigs(choice.alike.values(), family=list(choice.alike))
        ),
        "other_lengths": None
        if others is None
        else {
            "between_N": others.between,
            "members": _in_rigs(others.members, family=others.names),
        },
        "correlations": {
            "parameters": list(names),
            "matrix": [_finite(row) for row in matrix],
        },
        "residuals_N": result.residuals.tolist(),
        "weights": result.weights.tolist(),
        "start_objectives": _finite(result.starts),
        "start_parameters": {
            name: _finite(result.start_parameters[:, k])
            for k, name in enumerate(result.problem.names)
        },
        "muscle": muscle_as_dict(result.muscle),
    }


def _finite(values: Iterable[float]) -> list[float | None]:
    return [finite_or_none(value) for value in values]


def _rig(mounted: famjax.MountedMuscle) -> dict[str, Any]:
    """What the rig is: its exponent is not there where it gives way in proportion to the force."""
    compliance = {"series_compliance_m_per_N": float(mounted.compliance)}
    exponent = mounted.exponent
    return compliance if exponent is None else {**compliance, "series_exponent": float(exponent)}


def _in_rigs(
    muscles: Iterable[famjax.MountedMuscle], **about: Sequence[Any]
) -> list[dict[str, Any]]:
    """Muscles in their rigs, each with what is said about it."""
    found = []
    for one, *said in zip(muscles, *about.values(), strict=True):
        assert isinstance(one.muscle, famjax.Muscle)
        known = dict(zip(about, said, strict=True))
        found.append({**known, **_rig(one), "muscle": muscle_as_dict(one.muscle)})
    return found


def _spread(result: Identification, evidence: Evidence) -> dict[str, Any]:
    """What `predict` makes error bands of, see `muscle_spread`."""
    shared = () if evidence.shared is None else evidence.shared.directions
    return {
        "band": "linear" if evidence.bootstrap is None else "bootstrap",
        "directions": muscle_spread(result, evidence.bootstrap).tolist(),
        # To six digits: there may be thousands of numbers in a measured shape.
        "shared_directions": [[float(f"{value:.6g}") for value in row] for row in shared],
    }


def series_as_dict(series: Series, origin: Origin | None = None) -> dict[str, Any]:
    """The `fit.json` of a series: that of its first specimen, and what the others say."""
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
    fit: SavedFit, *, name: str | None = None, count: int = 32, seed: int = 0,
    origin: Origin | None = None,
) -> MuscleCard:  # fmt: skip
    """What a fit knows of a muscle, for those who use the muscle.

    The pull is what the rig of the fit measures; of a series, the weighted mean of both of its rigs.

    Args:
        fit: from `load_fit`.
        name: of the muscle; the specimen's unless given.
        count: of muscles in the sample; none of a fit that has no standard errors.
        seed: of the sample.
        origin: date and command of the card, beside those of the fit.

    Raises:
        InputError: the model is monotone nowhere, or hardly any muscle can be drawn.
    """
    document = fit.document
    if count < 0:
        raise InputError(f"the number of muscles in the sample must be >= 0, got {count}")
    members = (fit.mounted, *fit.others)
    readings = document["data"]["readings"]
    card = MuscleCard(
        name=name or document["data"]["specimen"].get("name") or "unnamed",
        members=members,
        weights=np.array(fit.weights),
        data=Region.of(readings["length_m"], readings["pressure_Pa"]),
        covariance=_covariance(document),
        draws=None,
        hysteresis=fit.hysteresis,
        provenance=_provenance(document, origin),
    )
    return dataclasses.replace(card, draws=_draws(card, document, count, seed))


def _draws(card: MuscleCard, document: dict, count: int, seed: int) -> Sample | None:
    directions = np.array((document.get("spread") or {}).get("directions") or [])
    if not (directions.size and count):
        return None
    return draw(card.members, card.weights, directions, card.region, seed=seed, count=count)


def _covariance(document: dict) -> Covariance | None:
    """Of the parameters that have a standard error, in parts of their values."""
    known = document["correlations"]
    names = known["parameters"]
    if not names:
        return None
    estimates = [document["parameters"][name] for name in names]
    values = np.array([one["value"] for one in estimates])
    scales = np.where(values == 0, 1.0, np.abs(values))
    stderr = np.array([one["stderr"] for one in estimates], float) / scales
    matrix = np.array(known["matrix"], float) * np.outer(stderr, stderr)
    units = [one["unit"] for one in estimates]
    return Covariance(names, units, values.tolist(), scales.tolist(), matrix.tolist())


def _provenance(document: dict, origin: Origin | None) -> Provenance:
    data, made = document["data"], document.get("origin") or {}
    here = {} if origin is None else origin.as_dict()
    commands = [one["command"] for one in (made, here) if one.get("command")]
    return Provenance(
        verdict=document.get("verdict"),
        reasons=document.get("reasons") or [],
        rmse_N=document.get("rmse_N"),
        max_error_N=document.get("max_error_N"),
        max_force_N=document.get("max_force_N"),
        model_error=document.get("model_error"),
        source=data.get("source"),
        data_sha256=data.get("sha256"),
        specimen={k: v for k, v in data["specimen"].items() if v is not None},
        date=here.get("date", made.get("date")),
        command=" && ".join(commands) or None,
        versions=document.get("versions") or {},
    )
