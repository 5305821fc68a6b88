"""Answers in the units of their question."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from famjax.boundary import sentence
from famjax.boundary.units import from_si, quantity_unit, unit_system

from ..terminal import print_rows

_KINDS = {"m": "length", "Pa": "pressure", "N": "force"}
"""Kind of the quantities of an answer, by the SI unit that its key ends in."""

_US = {"in", "psi"}


def answer_units(
    system: str | None, lengths: Sequence[str], pressures: Sequence[str]
) -> Mapping[str, str]:
    """Unit of each kind of quantity in the answer.

    Args:
        system: "si", "metric" or "us"; None for the units of the question.
        lengths: as they were typed, such as "270mm,250mm".
        pressures: the same.

    >>> answer_units(None, ["10in"], ["5 bar"])
    {'length': 'in', 'pressure': 'bar', 'force': 'N'}
    >>> answer_units(None, ["10in"], ["50psi"])["force"]
    'lbf'
    """
    if system is not None:
        return unit_system(system)
    length = quantity_unit(lengths[0])
    pressure = quantity_unit(pressures[0]) if pressures else "psi" if length == "in" else "kPa"
    force = "lbf" if {length, pressure} <= _US else "N"
    return {"length": length, "pressure": pressure, "force": force}


def in_units(rows: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> list[dict[str, Any]]:
    """Rows in SI in other units, the unit in each key as before.

    Args:
        rows: with keys such as `length_m`, `force_N`; what has no unit stays.
        units: of each kind, from `answer_units`.

    >>> in_units([{"length_m": 0.27, "slack": False}], {"length": "mm"})
    [{'length_mm': 270.0, 'slack': False}]
    """
    return [dict(_entry(key, value, units) for key, value in row.items()) for row in rows]


def _entry(key: str, value: Any, units: Mapping[str, str]) -> tuple[str, Any]:
    name, _, end = key.rpartition("_")
    if end not in _KINDS:
        return key, value
    unit = units[_KINDS[end]]
    return f"{name}_{unit}", None if value is None else from_si(value, unit, _KINDS[end])


def force_and_onset(rows: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """The tables of a prediction by their titles: forces, and onset pressures; none is empty."""
    tables = {
        "Force": [row for row in rows if "slack" in row],
        "Onset": [row for row in rows if "slack" not in row],
    }
    return {title: chosen for title, chosen in tables.items() if chosen}


def print_as_json(
    rows: Sequence[Mapping[str, Any]], system: str | None, units: Mapping[str, str]
) -> None:
    """Answers as one JSON list, in SI unless a unit system is asked for."""
    print(json.dumps(rows if system is None else in_units(rows, units), allow_nan=False))


def print_answers(title: str, rows: Sequence[Mapping[str, Any]], system: str | None) -> None:
    """A table of answers, with the model's force where some are slack, and why some are not inside."""
    slack = any(row.get("slack") for row in rows)
    hidden = ("outside",) if slack else ("outside", "model_force_")
    print_rows(title, [{k: v for k, v in row.items() if not k.startswith(hidden)} for row in rows])
    if slack:
        print("note: where the muscle is slack it pulls nothing; model force is what the model says "
              "there, not clipped")  # fmt: skip
    if not all(row["inside"] for row in rows):
        print("note: rows that are not inside lie beyond the fitted lengths or pressures:")
        for reason in dict.fromkeys(row["outside"] for row in rows if not row["inside"]):
            print(f"- {sentence.in_units(reason, system or 'metric')}")
