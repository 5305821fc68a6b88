"""`fit.json`: everything about a fit in one self-describing file; see `saved_fit` for the way back."""

import importlib.metadata
import platform
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.origin import Origin
from famjax.boundary.sentence import in_units
from famjax.boundary.units import finite_or_none, from_si, unit_system
from famjax.cards import muscle_as_dict

from ..choice import Choice, choice_as_dict
from ..data.force_csv import specimen_as_dict
from ..evidence.gathered import Evidence, evidence_as_dict, evidence_warnings
from ..evidence.spread import muscle_spread
from ..other_lengths import OtherLengths
from ..result import Estimate, Identification
from ..series import Series
from ..verdict.judgement import Judgement, judge
from ..verdict.series_judgement import judge_series
from .saved_fit import SCHEMA

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
        "reasons": [str(in_units(one, system)) for one in judged.reasons],
        "unchecked": str(in_units(judged.unchecked, system)) or None,
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
            str(in_units(one, system))
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
    data = result.data
    return {
        "schema": SCHEMA,
        "versions": versions(),
        "origin": None if origin is None else origin.as_dict(),
        "data": {
            "source": data.source,
            "sha256": data.sha256,
            "specimen": specimen_as_dict(data.specimen),
            "readings": {name: values.tolist() for name, values in data.columns().items()},
        },
        "seed": result.seed,
        "spread": _spread(result, evidence),
        **summary_as_dict(result, evidence=evidence, choice=choice, judgement=judgement),
        "averaged_with": [],
        "alike": [] if choice is None else _named(choice.alike),
        "other_lengths": None if choice is None else _other_lengths(choice.other_lengths),
        "correlations": {
            "parameters": list(names),
            "matrix": [[finite_or_none(value) for value in row] for row in matrix],
        },
        "residuals_N": result.residuals.tolist(),
        "weights": result.weights.tolist(),
        "start_objectives": [finite_or_none(cost) for cost in result.starts],
        "start_parameters": {
            name: [finite_or_none(value) for value in result.start_parameters[:, k]]
            for k, name in enumerate(result.problem.names)
        },
        "muscle": muscle_as_dict(result.muscle),
    }


def _rig(mounted: famjax.MountedMuscle) -> dict[str, Any]:
    """What the rig is: its exponent is not there where it gives way in proportion to the force."""
    compliance = {"series_compliance_m_per_N": float(mounted.compliance)}
    exponent = mounted.exponent
    return compliance if exponent is None else {**compliance, "series_exponent": float(exponent)}


def _averaged(others: Sequence[Identification], weights: Sequence[float]) -> list[dict[str, Any]]:
    """Muscles, besides the fit's own, that predictions are the mean of, with their weights."""
    return [
        {
            "weight": weight,
            "law": one.law.name,
            **_rig(one.mounted),
            "muscle": muscle_as_dict(one.muscle),
        }
        for one, weight in zip(others, weights, strict=True)
    ]


def _other_lengths(known: OtherLengths | None) -> dict[str, Any] | None:
    """What predictions of muscles of other lengths are made of."""
    if known is None:
        return None
    members = dict(zip(known.names, known.members, strict=True))
    return {"between_N": known.between, "members": _named(members)}


def _named(families: Mapping[str, famjax.MountedMuscle]) -> list[dict[str, Any]]:
    """Muscles in their rigs, by the names of their families."""
    found = []
    for name, one in families.items():
        assert isinstance(one.muscle, famjax.Muscle)
        found.append({"family": name, **_rig(one), "muscle": muscle_as_dict(one.muscle)})
    return found


def _spread(result: Identification, evidence: Evidence | None) -> dict[str, Any]:
    """What `predict` makes error bands of, see `muscle_spread`."""
    drawn = None if evidence is None else evidence.bootstrap
    directions = muscle_spread(result, drawn)
    shared = None if evidence is None else evidence.shared
    return {
        "band": "linear" if drawn is None else "bootstrap",
        "directions": directions.tolist(),
        "shared_directions": [] if shared is None else _short(shared.directions),
    }


def _short(rows: Float[np.ndarray, "directions numbers"]) -> list[list[float]]:
    """Errors to six digits: there may be thousands of numbers in a measured shape."""
    return [[float(f"{value:.6g}") for value in row] for row in rows]


def series_as_dict(series: Series, origin: Origin | None = None) -> dict[str, Any]:
    """The `fit.json` of a series: that of its first specimen, and what the others say."""
    data = [one.data for one in series.specimens]
    ratios = np.concatenate([one.length / one.specimen.rest_length for one in data])
    pressures = np.concatenate([one.pressure for one in data])
    predicted = series.left_out.group_rmse
    return {
        **fit_as_dict(
            series.specimens[0],
            origin=origin,
            judgement=judge_series(series.specimens, series.left_out),
        ),
        "averaged_with": _averaged([one[0] for one in series.others], series.weights[1:]),
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
