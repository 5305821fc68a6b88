"""Read the circuit and the friction of a plant from a plan for `famjax simulate`, a TOML file."""

import dataclasses
from pathlib import Path
from typing import Any

from . import plant
from .boundary.errors import InputError
from .boundary.toml_file import Form, from_entries, read_toml
from .continuation import SafeMuscle

_TABLES = ("circuit", "load", "friction", "controller", "step")
_UNITS = {"Pa": "pressure", "s": "time", "m": "length", "N": "force", "m3": "volume"}


def read_plan(plan: Path) -> dict[str, Any]:
    """Read the tables in a plan file.

    Raises:
        InputError: the file is missing, is not valid TOML, or has an unknown table.
    """
    tables = read_toml(plan, "plan")
    if unknown := tables.keys() - set(_TABLES):
        raise InputError(
            f"{plan}: unknown table {min(unknown)!r}; known tables are {', '.join(_TABLES)}"
        )
    return tables


def read_plant(plan: Path, muscle: SafeMuscle) -> plant.Plant:
    """Build a plant with a prescribed length from a muscle and from the circuit and friction in a plan.

    The tables [load] and [[step]] are ignored.

    Raises:
        InputError: the plan cannot be read (see `read_plan`), or a table is invalid.
    """
    tables = read_plan(plan)
    circuit, friction = circuit_of(tables, plan), friction_of(tables, plan, muscle)
    return plant.Plant(circuit, muscle, friction=friction)


def circuit_of(tables: dict[str, Any], plan: Path) -> plant.AbstractCircuit:
    """Build the circuit from the table [circuit]."""
    entries = dict(tables.get("circuit", {}))
    fluid = entries.pop("fluid", "air")
    if fluid not in ("air", "water"):
        raise InputError(f"{plan}: [circuit]: fluid must be 'air' or 'water', got {fluid!r}")
    made = plant.PneumaticCircuit() if fluid == "air" else plant.HydraulicCircuit()
    return _with_numbers(made, entries, f"{plan}: [circuit]: ")


def friction_of(tables: dict[str, Any], plan: Path, muscle: SafeMuscle) -> Any:
    """Build the friction from the table [friction]; without this table, return the muscle's hysteresis."""
    if "friction" in tables:
        return _with_numbers(plant.DahlFriction(), tables["friction"], f"{plan}: [friction]: ")
    return muscle.hysteresis


def _with_numbers(part: Any, entries: dict[str, Any], where: str) -> Any:
    """Replace parameters of a component with the entries of a table, in SI or in the unit in each key."""
    declared = part.declared()
    kinds = {name: _UNITS[one.unit] for name, one in declared.items() if one.unit in _UNITS}
    table = dataclasses.make_dataclass("table", [(n, float | None, None) for n in declared])
    given = dataclasses.asdict(from_entries(table, entries, Form(kinds), where=where))
    try:
        return dataclasses.replace(part, **{n: v for n, v in given.items() if v is not None})
    except InputError as problem:
        raise InputError(f"{where}{problem}") from None
