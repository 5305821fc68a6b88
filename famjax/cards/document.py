"""What stands in a card's file: the schema, as classes that a file is read into and checked by.

`muscle_card.schema.json` beside this file is `schema()`, for readers in other languages.
"""

import json
import math
import re
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import UNSET, Meta, Struct, UnsetType

from ..boundary.errors import InputError

SCHEMA = "famjax-card/1"

Pair = Annotated[list[float], Meta(min_length=2, max_length=2)]


class _Entry(Struct, forbid_unknown_fields=True):
    """An object of the file: no entry more, none less."""


class Member(_Entry):
    """One model of the muscle: its weight in the pull, and what it was fitted between."""

    muscle: Annotated[
        dict[str, Any], Meta(description="geometry and force terms, unit in each key")
    ]
    series_compliance_m_per_N: float
    weight: float
    series_exponent: Annotated[
        float | UnsetType,
        Meta(
            description="n of a rig that gives way by compliance 100 N (F/100 N)^n; 1 without one"
        ),
    ] = UNSET


class Ranges(_Entry):
    """A region of lengths and gauge pressures, shortest and lowest first."""

    length_m: Pair
    pressure_Pa: Pair


class Volume(_Entry):
    """The fluid's volume at every pair of a length and a pressure, one row for each length."""

    length_m: list[float]
    pressure_Pa: list[float]
    volume_m3: list[list[float]]


class Covariance(_Entry):
    """Covariance of the identified parameters, each in parts of its scale."""

    parameters: list[str]
    units: list[str]
    values: list[float]
    scales: list[float]
    matrix: list[list[float]]


class Sample(_Entry):
    """Numbers of the first member's model in muscles drawn from the covariance, a row for each."""

    seed: int
    numbers: list[str]
    rows: list[list[float]]


class Elements(_Entry):
    """Maxwell-slip elements on one coordinate."""

    thresholds: list[float]
    strengths_N: list[float]


class Cycle(_Entry):
    """The cycle whose branches the static map is the mean of; its ends in Pa or in m."""

    kind: Literal["ramp", "stroke"]
    cycled: bool
    start_Pa: float | UnsetType = UNSET
    turn_Pa: float | UnsetType = UNSET
    start_m: float | UnsetType = UNSET
    turn_m: float | UnsetType = UNSET


class Hysteresis(_Entry):
    """Elements about the static map, see `famjax.slip.CentredSlip`."""

    rest_length_m: float
    modulus_Pa: float
    wall: Elements
    braid: Elements
    cycle: Cycle


class Provenance(_Entry):
    """Where the card comes from."""

    verdict: str | None = None
    reasons: list[str] = []
    rmse_N: float | None = None
    max_error_N: float | None = None
    max_force_N: float | None = None
    model_error: dict[str, Any] | None = None
    source: str | None = None
    data_sha256: str | None = None
    specimen: dict[str, Any] = {}
    date: str | None = None
    command: str | None = None
    versions: dict[str, str] = {}
    notes: list[str] = []


def unidentified(name: str, verdict: str | None, reasons: Sequence[str] | None) -> str | None:
    """What whoever uses a muscle must know where its fit has identified nothing, or None.

    Args:
        name: of the file or the muscle.
        verdict: of the fit.
        reasons: of the verdict, the gravest first.
    """
    if verdict != "not identified":
        return None
    return f"{name} holds no identified muscle: {(reasons or ['see its report'])[0]}"


class CardDocument(_Entry):
    """A muscle card. Every number is SI, and its key ends in the unit."""

    schema: Literal["famjax-card/1"]
    name: str
    members: Annotated[list[Member], Meta(min_length=1)]
    rest_length_m: float
    data: Ranges
    monotone: Annotated[Ranges, Meta(description="where the pull is the model's own")]
    stops_m: Annotated[Pair, Meta(description="where the braid locks; where threads are straight")]
    volume: Volume | None
    covariance: Covariance | None
    sample: Sample | None
    hysteresis: Hysteresis | None
    provenance: Provenance


def schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a card's file."""
    found = msgspec.json.schema(CardDocument)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": SCHEMA, **found}


def checked(document: Any) -> CardDocument:
    """The content of a card's file, checked against the schema; every number finite.

    Raises:
        InputError: another schema, an entry that is missing, unknown or of the wrong kind.
    """
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise InputError(
            f"a muscle card must be of schema {SCHEMA!r}, got {schema!r}; make one of a fit by famjax "
            "card"
        )
    try:
        found = msgspec.convert(document, CardDocument)
    except msgspec.ValidationError as error:
        raise InputError(f"the muscle card is damaged: {error}") from None
    _check_finite(document, "$")
    for table, at, shape in _tables(found):
        try:
            fits = np.shape(table) == shape
        except ValueError:  # rows of unequal lengths
            fits = False
        if not fits:
            raise InputError(f"the muscle card is damaged: {at} must have the shape {shape}")
    return found


def _check_finite(value: Any, where: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"the muscle card is damaged: {where} must be finite, got {value}")
    if isinstance(value, dict):
        for key, one in value.items():
            _check_finite(one, f"{where}.{key}")
    if isinstance(value, list):
        for k, one in enumerate(value):
            _check_finite(one, f"{where}[{k}]")


def _tables(found: CardDocument) -> list[tuple[list, str, tuple[int, ...]]]:
    """Tables with the shape that their axes give them."""
    tables: list[tuple[list, str, tuple[int, ...]]] = []
    if (volume := found.volume) is not None:
        shape = len(volume.length_m), len(volume.pressure_Pa)
        tables.append((volume.volume_m3, "volume.volume_m3", shape))
    if (known := found.covariance) is not None:
        n = len(known.parameters)
        tables += [(known.matrix, "covariance.matrix", (n, n))]
        tables += [(getattr(known, of), f"covariance.{of}", (n,)) for of in ("values", "scales")]
    if (sample := found.sample) is not None:
        shape = len(sample.rows), len(sample.numbers)
        tables.append((sample.rows, "sample.rows", shape))
    return tables


def as_text(document: CardDocument) -> str:
    """The file's content: indented, one line for each row of numbers."""
    text = json.dumps(msgspec.to_builtins(document), indent=1, allow_nan=False)
    # A line break stands nowhere within a text of JSON, so that only lists are joined.
    return re.sub(r"\[\n([^\[\]{}]*)\n *\]", _on_one_line, text) + "\n"


def _on_one_line(found: re.Match[str]) -> str:
    return "[" + ", ".join(line.strip().rstrip(",") for line in found[1].split("\n")) + "]"
