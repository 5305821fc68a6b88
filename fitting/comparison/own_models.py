"""famjax's own models in the league table: identified in the physical box, Drucker-stable."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from famjax.boundary.errors import InputError

from ..data.force_data import ForceData
from ..evidence.left_out import LeftOut, leave_out_each
from ..evidence.validation import singles
from ..families.parameters import Parameter
from ..search.identification import identify
from ..search.result import Identification
from .row import ComparisonRow

_LEFT_OUT = ("pressure", "length")
_STARTS = 4  # of each refit, as `validate` has them
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
    row = dataclasses.replace(
        row,
        n_parameters=result.n_parameters,
        at_bound=tuple(e.name for e in result.estimates if e.at_bound),
    )
    held_out, refused = _held_out(result)
    for kind, reason in refused.items():
        row = row.noted(f"without a {kind}: {reason}")
    row = row.with_errors(result.residuals, *(held_out.get(kind) for kind in _LEFT_OUT))
    if not result.converged:
        row = row.noted("the fit did not converge")
    if not np.isfinite(result.errors.rmse):
        row = row.noted("the model has no force at some readings")
    return row


def _held_out(result: Identification) -> tuple[dict[str, LeftOut], dict[str, str]]:
    """What `validate` finds without each pressure and without each length, all refits in step.

    Returns:
        The errors, and what is said of kinds of groups that cannot be left out.
    """
    kinds, refused = {}, {}
    for kind in _LEFT_OUT:
        try:
            singles(result, kind)
        except InputError as reason:
            refused[kind] = str(reason)
        else:
            kinds[kind] = None, _STARTS
    fits = [(result.problem, result.end.u)]
    found = leave_out_each(fits, kinds, seed=result.seed + 1, settled=True, least=2)[0]
    return found, refused
