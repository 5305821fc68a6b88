"""The plant of a muscle in C: numbers of circuit and friction, and a table of the volume."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..boundary.errors import InputError
from ..plant import DahlFriction, HydraulicCircuit, Plant, PneumaticCircuit, SlipFriction
from ..slip import CentredSlip, MaxwellSlip
from .table import Subject, tabulated_volume

_WIDTH = 6  # numbers in a line of a source


def numbers_in_lines(values: Iterable[float], *, number: str = "R({})", end: str = "") -> str:
    """Numbers of a table in lines of a source.

    Args:
        values: the numbers.
        number: form of each.
        end: of each line but the last, after its comma.
    """
    words = [number.format(repr(float(value))) for value in values]
    rows = (", ".join(words[k : k + _WIDTH]) for k in range(0, len(words), _WIDTH))
    return f",{end}\n".join(f"    {row}" for row in rows)


def plant_words(subject: Subject) -> dict[str, Any]:
    """Words of the templates of a plant.

    Raises:
        InputError: a circuit or friction that has no C, or the muscle has no volume.
    """
    plant: Any = subject.plant
    if type(plant.circuit) not in (PneumaticCircuit, HydraulicCircuit):
        raise InputError(
            "a plant is exported with a PneumaticCircuit or a HydraulicCircuit; got "
            f"{type(plant.circuit).__name__}"
        )
    circuit = {name: getattr(plant.circuit, name) for name in plant.circuit.__dataclass_fields__}
    if circuit.get("relief", 0.0) is None:  # a valve that passes nothing
        circuit |= {"relief": 0.0, "relief_conductance": 0.0}
    friction, memory = _friction(plant.friction)
    lines = [*_defined("c", circuit), *friction, *_defined("f", {"viscosity": plant.viscosity})]
    nodes, values = tabulated_volume(subject.muscle)
    length, pressure = nodes["length"], nodes["pressure"]
    return {
        "FLUID": "air" if "atmosphere" in circuit else "water",
        "NUMBERS": "\n".join(lines),
        "HOLD_LENGTHS": len(length), "HOLD_LENGTH_NODES": numbers_in_lines(length),
        "HOLD_PRESSURES": len(pressure), "HOLD_PRESSURE_NODES": numbers_in_lines(pressure),
        "HOLD_NODES": numbers_in_lines(np.moveaxis(values, 0, -1).ravel()),
        **memory,
    }  # fmt: skip


def resting_signal(plant: Plant) -> float:
    """The signal at which nothing moves: a valve closed, a pump at rest."""
    return float(getattr(plant.circuit, "bias", 0.0))


def _friction(friction: Any) -> tuple[list[str], dict[str, Any]]:
    """Definitions of a friction, and the words of its memory."""
    none = {"MEMORY": 1, "THRESHOLDS": "", "STRENGTHS": ""}
    if friction is None:
        return [], none
    if type(friction) is DahlFriction:
        return _defined("f", friction.parameters()), none | {"MEMORY": 2}
    elements = getattr(friction, "elements", None)
    centred = isinstance(elements, CentredSlip)
    slip: Any = elements.slip if isinstance(elements, CentredSlip) else elements
    if type(friction) is not SlipFriction or not isinstance(slip, MaxwellSlip):
        raise InputError(
            "friction is exported as DahlFriction or as SlipFriction of Maxwell-slip elements; got "
            f"{type(friction).__name__}"
        )
    numbers: dict[str, Any] = {"rest_length": slip.rest_length, "modulus": slip.modulus}
    whole = {"wall": len(slip.wall.threshold), "cycle": 0, "cycled": 0}
    if centred:
        cycle = elements.cycle
        numbers |= {"start": cycle.start, "turn": cycle.turn}
        whole |= {"cycle": 1 + (cycle.kind == "stroke"), "cycled": int(cycle.cycled)}
    both = {
        of.upper() + "S": numbers_in_lines(
            np.concatenate([[1.0, 1.0], getattr(slip.wall, of), getattr(slip.braid, of)])
        )
        for of in ("threshold", "strength")
    }
    lines = [*_defined("f", numbers), *(f"#define f_{name} {one}" for name, one in whole.items())]
    return lines, {"MEMORY": 2 + len(slip.wall.threshold) + len(slip.braid.threshold), **both}


def _defined(letter: str, numbers: Mapping[str, Any]) -> list[str]:
    return [f"#define {letter}_{name} R({float(one)!r})" for name, one in numbers.items()]
