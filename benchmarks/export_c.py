"""The exported C on this machine: compiled strictly, called from Python, measured."""

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np

from famjax.export import Subject, export

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wconversion")
_KINDS = {"double": ctypes.c_double, "float": ctypes.c_float}

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]


def compiled(subject: Subject, folder: Path, real: str) -> Callable[[str], Function]:
    """The exported functions by what they return: force, stiffness, pressure.

    Args:
        subject: the muscle.
        folder: of the files.
        real: double or float.

    Raises:
        subprocess.CalledProcessError: the compiler warns.
    """
    export(subject, ["c"], folder)
    name, shared = subject.identifier, folder / f"{real}.so"
    define = f"-D{name.upper()}_REAL={real}"
    source = folder / f"{name}.c"
    command = ["gcc", *STRICT, "-Os", "-shared", "-fPIC", define, "-o", str(shared), str(source)]
    subprocess.run(command, check=True)
    loaded = ctypes.CDLL(str(shared))

    def function(what: str) -> Function:
        found = getattr(loaded, f"{name}_{what}")
        found.restype, found.argtypes = _KINDS[real], [_KINDS[real]] * 2
        return lambda a, b: np.array(
            [found(*one) for one in zip(a.tolist(), b.tolist(), strict=True)]
        )

    return function


def code_sections(
    source: Path, *options: str, compiler: str = "gcc", size: str = "size"
) -> dict[str, int]:
    """Bytes of each section of a source compiled for size.

    Args:
        source: of C.
        options: of the compiler, beside the strict ones.
        compiler: its command.
        size: the command that measures.
    """
    target = source.with_suffix(".o")
    command = [compiler, *STRICT, "-Os", *options, "-c", "-o", str(target), str(source)]
    subprocess.run(command, check=True)
    told = subprocess.run([size, "-A", str(target)], capture_output=True, text=True, check=True)
    rows = [line.split() for line in told.stdout.splitlines()]
    return {row[0]: int(row[1]) for row in rows if len(row) == 3 and row[1].isdigit()}


def exported_states(subject: Subject, count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Lengths and pressures, a half in the muscle's region and a half up to twice its ends."""
    rng = np.random.default_rng(seed)
    half = count // 2
    length, pressure = (
        np.concatenate([rng.uniform(axis[0], axis[-1], half), rng.uniform(0, 2 * axis[-1], half)])
        for axis in (subject.pull.lengths, subject.pull.pressures)
    )
    return length, pressure


def telling(subject: Subject, length: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Where a force tells the pressure: taut, between the stops, its area above 1 % of the mean."""
    states = [*zip(length.tolist(), pressure.tolist(), strict=True)]
    area, force = (
        np.array([ask(*one) for one in states]) for ask in (subject.pull.area, subject.pull.force)
    )
    between = (subject.pull.stops[0] < length) & (length < subject.pull.stops[1])
    mean = area[: len(area) // 2].mean()
    return between & (force > subject.pull.slack_width) & (area > 0.01 * mean)
