"""famjax's own models in the league table: identified in the physical box, Drucker-stable."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from famjax.boundary.errors import InputError

from ..data.force_data import ForceData
from ..evidence.validation import Validation, validate
from ..families.parameters import Parameter
from ..search.identification import identify
from .row import ComparisonRow

_ENDS = {"end_factor": Parameter()}
_BRAID = {"braid_compliance": Parameter()}

OWN: Mapping[str, tuple[str, dict[str, Any]]] = {
    "famjax_cubic": ("odd cubic", {"order": 3}),
    "famjax_ogden": ("Ogden", {"law": "ogden"}),
    "famjax_ogden_ends": ("Ogden, rounded ends", {"law": "ogden", "parameters": _ENDS}),
    "famjax_ogden_braid": ("Ogden, compliant braid", {"law": "ogden", "parameters": _BRAID}),
    "famjax_ogden_ends_braid": (
        "Ogden, rounded ends, compliant braid",
        {"law": "ogden", "parameters": _ENDS | _BRAID},
    ),
}
"""Label and options of `identify` by name."""


def identified_row(
    name: str, label: str, options: Mapping[str, Any], data: ForceData, starts: int, seed: int
) -> ComparisonRow:
    """The row of a muscle that `identify` fits; one that it refuses has a note and no errors."""
    row = ComparisonRow(name, label, 0)
    try:
        result = identify(data, starts=starts, seed=seed, **options)
    except InputError as refused:
        return row.noted(str(refused))
    held_out: dict[str, Validation | None] = {"pressure": None, "length": None}
    for kind in held_out:
        try:
            held_out[kind] = validate(result, kind)
        except InputError as refused:
            row = row.noted(f"without a {kind}: {refused}")
    at_bound = tuple(e.name for e in result.estimates if e.at_bound)
    row = row.with_errors(result.residuals, held_out["pressure"], held_out["length"]).at_bounds(
        result.n_parameters, at_bound
    )
    if not result.converged:
        row = row.noted("the fit did not converge")
    if not np.isfinite(result.errors.rmse):
        row = row.noted("the model has no force at some readings")
    return row
