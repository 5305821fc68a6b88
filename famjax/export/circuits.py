"""Export the plant of a muscle as C source with a table of volumes, and as an FMI 2.0 FMU."""

import hashlib
import importlib.resources
import io
import platform
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from .. import __version__
from ..boundary.errors import InputError
from ..plant import DahlFriction, HydraulicCircuit, Plant, PneumaticCircuit
from ..slip import CentredSlip, MaxwellSlip
from .table import Subject, tabulated_volume

_WIDTH = 6  # numbers per line of source


def numbers_in_lines(values: Iterable[float], *, number: str = "R({})", end: str = "") -> str:
    """Format the numbers of a table as lines of source code.

    Args:
        values: numbers to format.
        number: format of each number.
        end: continuation after the comma on each line except the last.
    """
    words = [number.format(repr(float(value))) for value in values]
    rows = (", ".join(words[k : k + _WIDTH]) for k in range(0, len(words), _WIDTH))
    return f",{end}\n".join(f"    {row}" for row in rows)


def plant_words(subject: Subject) -> dict[str, Any]:
    """Return the substitutions for the plant templates.

    Raises:
        InputError: there is no C code for the circuit or the friction, or the muscle has no volume.
    """
    plant: Any = subject.plant
    if type(plant.circuit) not in (PneumaticCircuit, HydraulicCircuit):
        raise InputError(
            f"a plant with a {type(plant.circuit).__name__} cannot be exported: use the air or water "
            "circuit from famjax"
        )
    circuit = {name: getattr(plant.circuit, name) for name in plant.circuit.__dataclass_fields__}
    if circuit.get("relief", 0.0) is None:  # no valve: zero conductance
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
    """Return the signal at which nothing moves: the valve is closed, or the pump is at rest."""
    return float(getattr(plant.circuit, "bias", 0.0))


def _friction(friction: Any) -> tuple[list[str], dict[str, Any]]:
    """Return the definitions for a friction model, and the substitutions for its memory."""
    none = {"MEMORY": 1, "THRESHOLDS": "", "STRENGTHS": ""}
    if friction is None:
        return [], none
    if type(friction) is DahlFriction:
        return _defined("f", friction.parameters()), none | {"MEMORY": 2}
    centred = isinstance(friction, CentredSlip)
    slip: Any = friction.slip if centred else friction
    if type(slip) is not MaxwellSlip:
        raise InputError(
            f"a {type(friction).__name__} cannot be exported: use DahlFriction, MaxwellSlip or CentredSlip"
        )
    numbers: dict[str, Any] = {"rest_length": slip.rest_length, "modulus": slip.modulus}
    whole = {"wall": len(slip.wall.threshold), "cycle": 0, "cycled": 0}
    if centred:
        cycle = friction.cycle
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


def filled(template: str, values: Mapping[str, Any]) -> bytes:
    """Replace the `@WORDS@` in a file from the folder `templates` with their values.

    Raises:
        KeyError: the value for a word is missing.
    """
    room = importlib.resources.files(__name__.rpartition(".")[0]) / "templates"
    text = (room / template).read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda found: str(values[found[1]]), text).encode()


_COMPILER = ("gcc", "-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden")


def fmu(subject: Subject, sources: Mapping[str, bytes]) -> bytes:
    """Build the FMU archive: description, sources, and a Linux binary if gcc is available.

    Args:
        subject: muscle with its plant.
        sources: C files for the muscle and the plant, by name.

    References:
        FMI 2.0.4, Modelica Association, 2022.
    """
    name, plant = subject.identifier, subject.plant
    assert plant is not None
    words: dict[str, Any] = {
        "name": name, "MODEL": quoteattr(subject.name), "TOOL": quoteattr(f"famjax {__version__}"),
        "ABOUT": quoteattr("; ".join(line.strip() for line in subject.about_table)),
        "HEADING": f" * {name}, exported by famjax {__version__}",
        "LENGTH": repr(float(subject.muscle.rest_length)), "SIGNAL": resting_signal(plant),
        "GUID": hashlib.sha256(b"".join(sources.values())).hexdigest()[:32],
    }  # fmt: skip
    files = {f"sources/{one}": content for one, content in sources.items()}
    files[f"sources/{name}_fmu.c"] = filled("fmu.c", words)
    files["modelDescription.xml"] = filled("fmu.xml", words)
    if shutil.which("gcc") and (platform.system(), platform.machine()) == ("Linux", "x86_64"):
        files |= _binary(name, files)
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        for one, content in files.items():
            archive.writestr(zipfile.ZipInfo(one), content, zipfile.ZIP_DEFLATED)
    return written.getvalue()


def _binary(name: str, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Compile the shared library; return {} if that fails, for example because C headers are missing."""
    with tempfile.TemporaryDirectory() as folder:
        for one, content in files.items():
            (Path(folder) / Path(one).name).write_bytes(content)
        parts = [f"{name}_fmu.c", f"{name}.c", "-o", f"{name}.so", "-lm"]
        done = subprocess.run([*_COMPILER, *parts], cwd=folder, check=False, capture_output=True)
        if done.returncode:
            return {}
        return {f"binaries/linux64/{name}.so": (Path(folder) / f"{name}.so").read_bytes()}
