"""Plans of `famjax simulate`: the circuit and the friction of a plant from a TOML file."""

import dataclasses
from pathlib import Path
from typing import Any

from .boundary.errors import InputError
from .boundary.toml_file import Form, from_entries, read_toml
from .continuation import SafeMuscle
from .plant import (
    AbstractCircuit,
    AbstractFriction,
    DahlFriction,
    HydraulicCircuit,
    Plant,
    PneumaticCircuit,
    SlipFriction,
)

_TABLES = ("circuit", "load", "friction", "controller", "step")
_UNITS = {"Pa": "pressure", "s": "time", "m": "length", "N": "force", "m3": "volume"}


def read_plan(plan: Path) -> dict[str, Any]:
    """The tables of a plan.

    Raises:
        InputError: no such file, no TOML, or an unknown table.
    """
    tables = read_toml(plan, "plan")
    if unknown := tables.keys() - set(_TABLES):
        raise InputError(f"{plan}: unknown table {min(unknown)!r}; known are {', '.join(_TABLES)}")
    return tables


def read_plant(plan: Path, muscle: SafeMuscle) -> Plant:
    """A muscle with circuit and friction of a plan, its length driven; load and steps are not read.

    Raises:
        InputError: as `read_plan`, or what a table has wrong.
    """
    tables = read_plan(plan)
    circuit, friction = circuit_of(tables, plan), friction_of(tables, plan, muscle)
    return Plant(circuit, muscle, friction=friction)


def circuit_of(tables: dict[str, Any], plan: Path) -> AbstractCircuit:
    """The circuit of the table [circuit]."""
    entries = dict(tables.get("circuit", {}))
    fluid = entries.pop("fluid", "air")
    if fluid not in ("air", "water"):
        raise InputError(f"{plan}: [circuit]: fluid must be 'air' or 'water', got {fluid!r}")
    made = PneumaticCircuit() if fluid == "air" else HydraulicCircuit()
    return _with_numbers(made, entries, f"{plan}: [circuit]: ")


def friction_of(tables: dict[str, Any], plan: Path, muscle: SafeMuscle) -> AbstractFriction | None:
    """The friction of the table [friction], or the muscle's hysteresis."""
    if "friction" in tables:
        return _with_numbers(DahlFriction(), tables["friction"], f"{plan}: [friction]: ")
    return None if muscle.hysteresis is None else SlipFriction(muscle.hysteresis)


def _with_numbers(part: Any, entries: dict[str, Any], where: str) -> Any:
    """A part with the numbers of a table in place of its own: units in the key, or SI."""
    declared = part.declared()
    kinds = {name: _UNITS[one.unit] for name, one in declared.items() if one.unit in _UNITS}
    table = dataclasses.make_dataclass("table", [(n, float | None, None) for n in declared])
    given = dataclasses.asdict(from_entries(table, entries, Form(kinds), where=where))
    try:
        return dataclasses.replace(part, **{n: v for n, v in given.items() if v is not None})
    except InputError as problem:
        raise InputError(f"{where}{problem}") from None
