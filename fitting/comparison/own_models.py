"""famjax's own models in the league table: identified in the physical box, Drucker-stable."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from famjax.boundary.errors import InputError

from ..data.force_data import ForceData
from ..evidence.refit import refit
from ..evidence.validation import validate
from ..families.parameters import Parameter
from ..search.identification import identify
from ..search.multi_start import latin_hypercube
from ..search.result import Identification
from .row import ComparisonRow, HeldOut

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


@dataclasses.dataclass(frozen=True)
class _Errors:
    """On readings that were left out [N], see `HeldOut`."""

    rmse: float
    interior_rmse: float

    @classmethod
    def of(cls, square: list[np.ndarray]) -> "_Errors":
        """From the squared errors on each group."""
        inner = square[1:-1]
        return cls(_rms(square), _rms(inner) if inner else math.nan)


def _rms(square: list[np.ndarray]) -> float:
    return math.sqrt(float(np.concatenate(square).mean()))


def identified_row(
    name: str, label: str, options: Mapping[str, Any], data: ForceData, starts: int, seed: int
) -> ComparisonRow:
    """The row of a muscle that `identify` fits; one that it refuses has a note and no errors."""
    row = ComparisonRow(name, label, 0)
    try:
        result = identify(data, starts=starts, seed=seed, **options)
    except InputError as refused:
        return row.noted(str(refused))
    held_out, refused = _held_out(result)
    for kind, reason in refused.items():
        row = row.noted(f"without a {kind}: {reason}")
    at_bound = tuple(e.name for e in result.estimates if e.at_bound)
    row = row.with_errors(result.residuals, *(held_out.get(kind) for kind in _LEFT_OUT)).at_bounds(
        result.n_parameters, at_bound
    )
    if not result.converged:
        row = row.noted("the fit did not converge")
    if not np.isfinite(result.errors.rmse):
        row = row.noted("the model has no force at some readings")
    return row


def _held_out(result: Identification) -> tuple[dict[str, HeldOut], dict[str, str]]:
    """What `validate` finds without each pressure and without each length, all refits in step.

    Returns:
        The errors, and what is said of kinds of groups that cannot be left out.
    """
    problem, found, refused = result.problem, {}, {}
    read = problem.side == 0
    groups = {}
    for kind in _LEFT_OUT:
        label = problem.levels(kind)
        groups[kind] = [label == level for level in np.unique(label[read])]
    if result.dependence == "free" or min(map(len, groups.values())) < 2:
        for kind in _LEFT_OUT:
            try:
                found[kind] = validate(result, kind, starts=_STARTS)
            except InputError as reason:
                refused[kind] = str(reason)
        return found, refused
    out = [group for kind in _LEFT_OUT for group in groups[kind]]
    cube = latin_hypercube(len(problem.free), _STARTS, result.seed + 1)
    cube[0] = result.end.u
    refits = refit([problem.with_readings(factor=1.0 * ~one) for one in out], [cube] * len(out))
    square = [error[one & read] ** 2 for one, error in zip(out, refits.residual, strict=True)]
    first = len(groups["pressure"])
    return {"pressure": _Errors.of(square[:first]), "length": _Errors.of(square[first:])}, refused
