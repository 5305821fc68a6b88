"""The muscle back from a `fit.json`, and the figures about it."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import famjax
from famjax.boundary.errors import InputError
from famjax.cards import muscle_from_dict

SCHEMA = "famjax-fit/1"


@dataclasses.dataclass(frozen=True)
class SavedFit:
    """A fit read back from `fit.json`.

    Attributes:
        muscle: the identified muscle, bit for bit.
        document: the whole file as plain data, SI.
    """

    muscle: famjax.Muscle
    document: dict[str, Any]


def load_fit(path: str | Path) -> SavedFit:
    """The muscle and the figures of a saved fit.

    Args:
        path: a `fit.json`.

    Returns:
        The fit. Enable float64 in JAX first, or the muscle's numbers are rounded to float32.

    Raises:
        InputError: no such file, not a fit of this program, or of a schema it does not know.
    """
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path} is not a JSON file: {error}") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise InputError(f"{path} must be a fit of schema {SCHEMA!r}, got {schema!r}")
    return SavedFit(muscle_from_dict(document["muscle"]), document)


def finite_or_none(value: float) -> float | None:
    """The value, or None (JSON null) where it is nan or infinite."""
    return float(value) if math.isfinite(value) else None
