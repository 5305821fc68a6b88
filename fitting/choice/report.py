"""What was tried and what was chosen, as a table and as JSON."""

import math
from typing import Any

from famjax.boundary.units import from_si, unit_system

from .choose import Choice
from .ranking import Tried

_ROWS = 12  # of the table; the file has all


def choice_as_dict(choice: Choice) -> dict[str, Any]:
    """JSON-ready, SI."""
    return {
        "chosen": choice.names[0],
        "averaged": list(choice.names),
        "averaged_rmse_N": choice.rmse,
        "clear": choice.clear,
        "left_out": list(choice.dropped),
        "tried": [
            {
                "family": one.candidate.name,
                "unknowns": one.candidate.unknowns,
                "rmse_N": one.rmse,
                **{
                    f"leave_{kind}s_out_rmse_N": _number(one, kind)
                    for kind in ("pressure", "length")
                },
                "behind": one.behind[0],
                "behind_std": one.behind[1],
                "as_good": one.as_good,
            }
            for one in choice.tried
        ],
    }


def choice_table(choice: Choice, system: str) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    """Title, header and rows of text, the best family first."""
    unit = unit_system(system)["force"]

    def force(value: float | None) -> str:
        return "" if value is None else f"{from_si(value, unit, 'force'):.4g}"

    def part(one: Tried) -> str:
        if one.candidate.name == choice.names[0]:
            return "chosen"
        if one.candidate.name in choice.names:
            return "averaged"
        return "as good" if one.as_good else ""

    rows = [
        (
            one.candidate.name,
            str(one.candidate.unknowns),
            force(one.rmse),
            force(_number(one, "pressure")),
            force(_number(one, "length")),
            f"{'' if one.left_out or not choice.left_out else 'over '}{math.exp(one.behind[0]):.3g}",
            part(one),
        )
        for one in choice.tried[:_ROWS]
    ]
    more = len(choice.tried) - len(rows)
    title = f"Families tried, RMSE in {unit}" + (
        f" ({more} worse ones are in fit.json)" if more > 0 else ""
    )
    return (
        title,
        ("family", "unknowns", "in sample", "pressures out", "lengths out", "times the best", ""),
        rows,
    )


def _number(one: Tried, kind: str) -> float | None:
    found = one.left_out.get(kind)
    return None if found is None else found.rmse
