"""Models in the league table that are not of other authors: famjax's own, and those of a user.

famjax's are identified in the physical box, Drucker-stable.
"""

import dataclasses
import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np

import famjax
from famjax.boundary.class_path import class_named, class_path
from famjax.boundary.errors import InputError

from ..choice import choose
from ..data import ForceData
from ..identification import identify
from ..nested import MOST, validate_choice
from ..posing import own_parts, taking_part
from ..result import Identification
from ..validation import LeftOut, check_groups, leave_out_each
from .peer_family import PeerFamily
from .row import ComparisonRow

_LEFT_OUT = ("pressure", "length")
_STARTS = 4  # of each refit, as `validate` has them
CHOICE = "famjax_choice"
_PRESSURE_GROUPS = 8  # that the choice is made anew without, as it judges its families

OWN: Mapping[str, tuple[str, dict[str, Any]]] = {
    "famjax_cubic": ("odd cubic", {"order": 3}),
    "famjax_ogden": ("Ogden", {"law": "ogden"}),
}
"""Label and options of `identify` by name."""


def choice_row(data: ForceData, starts: int, seed: int) -> ComparisonRow:
    """What `choose` finds, made anew without each length and each group of pressures that it predicts."""
    row = ComparisonRow(CHOICE, "famjax, its own choice (nested)", 0)
    try:
        choice = choose(data, starts=starts, seed=seed)
    except InputError as refused:
        return row.noted(str(refused))
    held_out: list[LeftOut | None] = []
    for groups, most in (("pressure", _PRESSURE_GROUPS), ("length", MOST)):
        try:
            held_out.append(validate_choice(choice, groups, most=most, starts=_STARTS, seed=seed))
        except InputError as refused:
            held_out.append(None)
            row = row.noted(f"without a {groups}: {refused}")
    result = choice.chosen
    row = dataclasses.replace(
        row, n_parameters=result.n_parameters,
        at_bound=tuple(one.name for one in result.estimates if one.at_bound),
    ).noted(f"it chose: {choice.name}")  # fmt: skip
    return row.with_errors(result.residuals, *held_out)


def own_model(path: str | type, data: ForceData) -> tuple[str, dict[str, Any]] | PeerFamily:
    """A model of a user's own by the class that it is, or the part of one.

    Args:
        path: the class, or `module:Class`, of a whole model with declared parameters, derived from
            `famjax.AbstractMuscle`; or of a law, a geometry or a force term, which is identified with
            what else a muscle has.
        data: the map.

    Returns:
        A peer, or a name and options of `identify`.

    Raises:
        InputError: no such class, or one that cannot be fitted by its class alone.
    """
    if isinstance(path, type):
        kind, path = path, class_path(path)
    else:
        kind = class_named(path, famjax.parameters.Parametrised, "model")
    if issubclass(kind, famjax.AbstractMuscle):
        fields = {one.name for one in dataclasses.fields(kind)}
        known = {"rest_length": data.specimen.rest_length} if "rest_length" in fields else {}
        try:
            return PeerFamily.of(kind.template(**known), path)
        except ValueError as error:
            raise InputError(f"{path} cannot be fitted by its class alone: {error}") from None
    if issubclass(kind, famjax.materials.AbstractMaterial):
        return path, {"law": kind}
    is_geometry = issubclass(kind, famjax.geometries.AbstractGeometry)
    parts, declared = own_parts([data], *((kind, ()) if is_geometry else (None, (kind,))))
    return path, {**parts, "parameters": taking_part(declared, {})}


def check_options(name: str, options: Mapping[str, Any]) -> None:
    """Raise unless these are options of `identify`.

    Raises:
        InputError: they are not.
    """
    unknown = options.keys() - inspect.signature(identify).parameters.keys()
    if unknown:
        raise InputError(f"{name}: identify has no option {', '.join(sorted(unknown))}")


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
            check_groups(result, kind)
        except InputError as reason:
            refused[kind] = str(reason)
        else:
            kinds[kind] = None, _STARTS
    fits = [(result.problem, result.end.u)]
    found = leave_out_each(fits, kinds, seed=result.seed + 1, settled=True, least=2)[0]
    return found, refused
