"""What a search found, as plain rows and sentences, the unit in each key."""

import dataclasses
import io
import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from ...boundary.extras import import_extra
from ...boundary.units import Row, entry, factor, from_si, unit_system
from .chunk import Columns
from .limits import COLUMNS, CONSTRAINTS
from .space_search import SpaceSearch

_REASONS = {
    "braid": "the braid does not fit the bladder",
    "end_fitting": "no swage tube of the catalogue fits",
    "untested": "a factor is asked for that is not known of them",
}


def design_rows(found: SpaceSearch, columns: Columns, *, system: str = "si") -> list[Row]:
    """Some candidates of a search, in their order; None where a number is not known.

    Args:
        found: from `search_space`.
        columns: its `front`, `sample` or `nearest`.
        system: "si", "metric" or "us".

    Returns:
        Rows of bladder, braid, how they fit, tube and the numbers of the columns.
    """
    count = len(next(iter(columns.values()), ()))
    return [
        _row(found, {name: values[at] for name, values in columns.items()}, system)
        for at in range(count)
    ]


def _row(found: SpaceSearch, numbers: Mapping[str, Any], system: str) -> Row:
    pair = found.pairs[int(numbers["pair"])]
    row: Row = {"bladder": pair.bladder.name, "braid": pair.braid.name}
    row |= {"feasibility": str(pair.fit), "tube": pair.tube}
    for name, kind in COLUMNS.items():
        row |= entry(name, float(numbers[name]), kind, system)
    return row


def refinement_rows(found: SpaceSearch, *, system: str = "si") -> list[Row]:
    """Each goal of a search: the refined design, and where it started."""
    return [
        {"goal": one.goal, "gain": one.gain}
        | _row(found, one.end, system)
        | {"start": _row(found, one.start, system)}
        for one in found.refined
    ]


def exclusion_rows(found: SpaceSearch, *, system: str = "si") -> list[Row]:
    """What each constraint leaves out, the most first; those that leave out nothing are not there."""
    return [
        {
            "constraint": one.constraint,
            **entry("limit", one.limit, COLUMNS[CONSTRAINTS[one.constraint][0]], system),
            **entry("closest", one.closest, COLUMNS[CONSTRAINTS[one.constraint][0]], system),
            "excluded": one.excluded,
            "alone": one.alone,
        }
        for one in found.exclusions
    ]


def search_document(found: SpaceSearch, *, system: str = "si") -> dict[str, Any]:
    """Everything that a search found but the table of feasible candidates, JSON-ready.

    Args:
        found: from `search_space`.
        system: "si", "metric" or "us".

    Returns:
        `search` (what was asked for, in SI, and how many candidates there were), `front`, `refined`,
        `exclusions`, `nearest` (where nothing is feasible) and `notes`.
    """
    asked = dataclasses.asdict(found.requirement) | dataclasses.asdict(found.limits)
    return {
        "search": {
            "candidates": found.grid.total,
            "feasible": found.feasible,
            "objectives": list(found.objectives),
            "front_step": found.front_step,
            "asked_si": {k: v if math.isfinite(v) else None for k, v in asked.items()},
            "ranges_si": {k: list(v) for k, v in dataclasses.asdict(found.ranges).items()},
            "pairs": [
                {"bladder": pair.bladder.name, "braid": pair.braid.name, "points": points}
                for pair, points in zip(found.pairs, found.grid.counts.tolist(), strict=True)
            ],
            "pairs_left_out": found.left_out,
        },
        "front": design_rows(found, found.front, system=system),
        "refined": refinement_rows(found, system=system),
        "exclusions": exclusion_rows(found, system=system),
        "nearest": design_rows(found, found.nearest, system=system),
        "notes": list(found.notes),
    }


def feasible_table(
    found: SpaceSearch, form: Literal["csv", "parquet"], *, system: str = "si"
) -> bytes:
    """The feasible candidates of a search, `sample`, as a file.

    Args:
        found: from `search_space`.
        form: "csv", or "parquet" with the extra "tables".
        system: "si", "metric" or "us".

    Raises:
        InputError: "parquet" without the extra.
    """
    pairs = found.sample.get("pair", np.zeros(0, dtype=np.int64))
    columns: dict[str, Any] = {
        "bladder": [found.pairs[at].bladder.name for at in pairs],
        "braid": [found.pairs[at].braid.name for at in pairs],
    }
    for name, kind in COLUMNS.items():
        unit = unit_system(system)[kind]
        values = np.asarray(found.sample.get(name, ()), dtype=np.float64)
        columns[f"{name}_{unit}" if unit else name] = values / factor(unit, kind)
    if form == "parquet":
        file = io.BytesIO()
        arrow = import_extra("pyarrow", "tables")
        import_extra("pyarrow.parquet", "tables").write_table(arrow.table(columns), file)
        return file.getvalue()
    lines = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join(v if isinstance(v, str) else f"{v:.9g}" for v in row))
    return ("\n".join(lines) + "\n").encode()


def summary(found: SpaceSearch, *, system: str = "si") -> list[str]:
    """What was searched and, where nothing is feasible, why: sentences for a person.

    Args:
        found: from `search_space`.
        system: "si", "metric" or "us".
    """
    said = [
        f"{found.feasible:,} of {found.grid.total:,} candidates, of {len(found.pairs)} pairs of "
        "bladder and braid, meet everything."
    ]
    left_out = {reason: n for reason, n in found.left_out.items() if n}
    if left_out:
        reasons = ", ".join(f"{n}: {_REASONS[reason]}" for reason, n in left_out.items())
        said.append(f"Pairs left out: {reasons}.")
    if found.feasible:
        return said
    said += [
        f"{one.excluded:,} fail the {one.constraint.replace('_', ' ')}, {one.alone:,} of them that "
        f"alone: asked for is {_limit(one.constraint, one.limit, system)}, the best of all is "
        f"{_said(CONSTRAINTS[one.constraint][0], one.closest, system)}."
        for one in found.exclusions
    ]
    if found.nearest:
        said.append(_nearest(found, system))
    return said


def _nearest(found: SpaceSearch, system: str) -> str:
    numbers = {name: float(values[0]) for name, values in found.nearest.items()}
    asked = {**vars(found.requirement), **vars(found.limits)}
    missed = []
    for constraint, (column, side) in CONSTRAINTS.items():
        limit, value = asked[constraint], numbers[column]
        kept = value <= limit if side == "most" else value >= limit
        if not kept and (limit > 0 or constraint == "force"):
            name = constraint.replace("_", " ")
            missed.append(
                f"{name} {_said(column, value, system)}, not {_limit(constraint, limit, system)}"
            )
    return (
        f"Nearest miss, by {numbers['shortfall']:.2%} at the worst: "
        f"{found.pairs[int(numbers['pair'])].name}, rest length "
        f"{_said('rest_length', numbers['rest_length'], system)}, "
        f"{_said('pressure', numbers['pressure'], system)}: {'; '.join(missed)}."
    )


def _limit(constraint: str, limit: float, system: str) -> str:
    column, side = CONSTRAINTS[constraint]
    return f"at {'most' if side == 'most' else 'least'} {_said(column, limit, system)}"


def _said(column: str, value: float, system: str) -> str:
    """A number with its unit."""
    if math.isnan(value):
        return "none that can be reached"
    unit = unit_system(system)[COLUMNS[column]]
    return f"{from_si(value, unit, COLUMNS[column]):.4g} {unit}".strip()
