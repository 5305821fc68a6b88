"""The muscle card of a saved fit."""

import dataclasses

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.origin import Origin
from famjax.cards import Covariance, Draws, MuscleCard, Provenance, draw
from famjax.continuation import Region

from .saved_fit import SavedFit


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


def _draws(card: MuscleCard, document: dict, count: int, seed: int) -> Draws | None:
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
