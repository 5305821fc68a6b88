"""What was tried and what was chosen, as a table and as JSON."""

from typing import Any

import numpy as np

from famjax.boundary.units import finite_or_none, from_si, unit_system

from .choose import Choice
from .ranking import Tried

_HEADER = {
    "pressure": "pressures out",
    "interior length": "interior lengths out",
    "end length": "end lengths out",
}
"""Columns of held-out errors, those that there are."""


def choice_as_dict(choice: Choice) -> dict[str, Any]:
    """JSON-ready, SI."""
    return {
        "chosen": choice.name,
        "clear": choice.clear,
        "open_question": choice.open_question or None,
        "left_out": list(choice.dropped),
        "tried": [
            {
                "family": one.candidate.name,
                "unknowns": one.candidate.unknowns,
                "rmse_N": one.rmse,
                **{
                    f"{kind.replace(' ', '_')}s_out_rmse_N": one.columns.get(kind)
                    for kind in _HEADER
                },
                "held_out_N": finite_or_none(one.held_out),
                "fits_alike": one.alike,
            }
            for one in choice.tried
        ],
    }


def choice_table(choice: Choice, system: str) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    """Title, header and rows of text: the chosen family, then the others by their held-out errors."""
    unit = unit_system(system)["force"]

    def force(value: float | None) -> str:
        if value is None or not np.isfinite(value):
            return ""
        return f"{from_si(value, unit, 'force'):.4g}"

    def part(one: Tried) -> str:
        if one is choice.tried[0]:
            return "chosen"
        return "fits alike" if one.alike else ""

    kinds = [kind for kind in _HEADER if kind in choice.tried[0].columns]
    rows = [
        (
            one.candidate.name, str(one.candidate.unknowns), force(one.rmse),
            *(force(one.columns.get(kind)) for kind in kinds), force(one.held_out), part(one),
        )
        for one in choice.tried
    ]  # fmt: skip
    title = f"Families tried, RMSE in {unit}; the held-out error is the geometric mean of the columns out"
    header = (
        "family",
        "unknowns",
        "in sample",
        *(_HEADER[kind] for kind in kinds),
        "held-out error",
        "",
    )
    return title, header, rows
