"""Export targets: C, FMU, MATLAB, Python and tables; see `mujoco.py` for MuJoCo and MJX."""

import dataclasses
import functools
import io
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..boundary.errors import InputError
from ..boundary.files import check_output, write_all
from ..plant import Plant, PneumaticCircuit
from .circuits import filled, fmu, numbers_in_lines, plant_words
from .closed_form import ClosedForm, closed_form, matlab_words, python_words
from .mujoco import docstring, mjx_files, mujoco_files, table_words
from .table import Subject, check_float64

Files = dict[str, bytes]
"""File contents by name."""

_LENGTHS, _PRESSURES = 129, 41  # grid of a CSV file
_FARTHEST = 2.0  # length, relative to the longest, above which a closed form assumes a wrong unit
_SAME = 2e-3  # largest difference between a measured and a fitted rest length, as a fraction
_ASKED = 1000  # states
_BEYOND = 0.5  # extension of the grid, as a fraction of the distance from the data to a stop


def c_files(subject: Subject) -> Files:
    """Write a C header and source that need no allocation or libraries; double precision by default."""
    name, words = subject.identifier, _words(subject, " *", "R({})")
    files = {f"{name}.{of}": filled(f"force.{of}", words) for of in ("h", "c")}
    if subject.plant is None:
        return files
    words |= plant_words(subject)
    files[f"{name}.c"] += filled("plant.c", words)
    return files | {f"{name}_plant.h": filled("plant.h", words)}


def fmu_files(subject: Subject) -> Files:
    """Write `NAME.fmu` (FMI 2.0, model exchange and co-simulation) with sources and, with gcc, a binary.

    If the subject has no plant, a `PneumaticCircuit` is used.
    """
    if subject.plant is None:
        friction = subject.muscle.hysteresis
        plant = Plant(PneumaticCircuit(), subject.muscle, friction=friction)
        subject = dataclasses.replace(subject, plant=plant)
    return {f"{subject.identifier}.fmu": fmu(subject, c_files(subject))}


def matlab_files(subject: Subject) -> Files:
    """Write `NAME_force.m` and `NAME_pressure.m`, which contain the equations if there is a closed form.

    Otherwise the functions call `NAME_model_force.m`, which contains a table. The functions need no
    toolbox and work in a MATLAB Function block in Simulink.
    """
    name, closed = subject.identifier, _closed(subject, "%   ", matlab_words)
    if closed is not None:
        return {f"{name}_{of}.m": filled(f"closed_{of}.m", closed) for of in ("force", "pressure")}
    words = _words(subject, "%  ", "{}", end=" ...")
    files = [f"{of}.m" for of in ("table_force", "table_pressure", "model_force")]
    return {f"{name}_{one.removeprefix('table_')}": filled(one, words) for one in files}


def python_files(subject: Subject) -> Files:
    """Write `NAME.py`, which needs only NumPy and contains the closed-form equations or a table."""
    name, closed = subject.identifier, _closed(subject, "", python_words)
    if closed is not None:
        return {f"{name}.py": filled("closed.py.in", closed)}
    return {f"{name}.py": filled("table.py.in", table_words(subject))}


def _closed(
    subject: Subject, comment: str, written: Callable[[ClosedForm], dict[str, str]]
) -> dict[str, Any] | None:
    """Return the substitutions for the closed-form templates; None if the muscle has no closed form."""
    check_float64()
    inside, muscle = subject.muscle.continued, subject.muscle
    form = closed_form(inside.muscle)
    if form is None:
        return None
    (short, long), pressures = map(float, inside.region.length), map(float, inside.region.pressure)
    rest = float(inside.muscle.rest_length)
    # The rest length was fitted within its rounding; the longest measured length is meant to be inside.
    ends = (short, rest if 0 < rest / long - 1 < _SAME else long, *pressures)
    words = {
        "name": subject.identifier, "NAME": subject.identifier.upper(), "HEADING": "",
        **dict(zip(("SHORTEST", "LONGEST", "LOWEST", "HIGHEST"), ends, strict=True)),
        "SLACK": float(muscle.slack_width), "FARTHEST": f"{_FARTHEST * ends[1]:.3g}",
    }  # fmt: skip
    module: dict[str, Any] = {}
    exec(compile(filled("closed.py.in", words | python_words(form)), "", "exec"), module)
    rng = np.random.default_rng(0)
    L, P = (rng.uniform(low, high, _ASKED) for low, high in (ends[:2], ends[2:]))
    force = np.asarray(muscle.force(L, P))
    off = float(np.abs(module["force"](L, P) - force).max() / force.max())
    own = [line.replace("continued beyond", "NaN beyond") for line in subject.about]
    about = [*own, f"model in closed form; errors at {_ASKED} random states are below {off:.1e} of the "
             "largest force"]  # fmt: skip
    heading = "\n".join(f"{comment}{line}" for line in docstring(about).split("\n"))
    return words | written(form) | {"HEADING": heading}


def csv_files(subject: Subject) -> Files:
    """Write `length_m,pressure_Pa,force_N,model_force_N,stiffness_N_per_m,area_m2`, one row per state."""
    grid, about = _grid(subject)
    L, P = np.meshgrid(grid["length_m"], grid["pressure_Pa"], indexing="ij")
    columns = [column.ravel().tolist() for column in (L, P, *list(grid.values())[2:])]
    lines = [*(f"# {line}" for line in about), ",".join(grid)]
    lines += [",".join(map(repr, row)) for row in zip(*columns, strict=True)]
    return {f"{subject.identifier}.csv": "\n".join([*lines, ""]).encode()}


def mat_files(subject: Subject) -> Files:
    """Write the axes and tables of the CSV file, under the same names, for a 2-D Lookup Table block."""
    from scipy.io import savemat  # noqa: PLC0415 -- slow to import

    grid, about = _grid(subject)
    written = io.BytesIO()
    savemat(written, {**grid, "about": "\n".join(about)}, oned_as="column", do_compression=True)
    return {f"{subject.identifier}.mat": written.getvalue()}


TARGETS: dict[str, Callable[[Subject], Files]] = {
    "c": c_files, "fmu": fmu_files, "csv": csv_files, "mat": mat_files, "matlab": matlab_files,
    "python": python_files, "mujoco": mujoco_files, "mjx": mjx_files,
}  # fmt: skip
"""Functions that create the files, by the names used in `famjax export --to`."""


def export(subject: Subject, to: Sequence[str], folder: str | Path) -> list[Path]:
    """Export a muscle to several targets; either all files are written or none.

    Args:
        subject: muscle to export, see `read_subject` and `Subject.of_card`.
        to: names in `TARGETS`.
        folder: folder for the files, created if missing.

    Returns:
        Paths of the files.

    Raises:
        InputError: a target is unknown, or the muscle cannot be exported to it.
    """
    unknown = [name for name in to if name not in TARGETS]
    if unknown or not to:
        raise InputError(
            f"targets must be one or more of {', '.join(TARGETS)}; got {', '.join(unknown) or 'none'}"
        )
    check_output(Path(folder))
    files: Files = {}
    for name in dict.fromkeys(to):
        files |= TARGETS[name](subject)
    return write_all(Path(folder), files)


def _grid(subject: Subject) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the axes, the tables and the header lines, which state the error of bilinear interpolation."""
    pull = subject.pull
    (short, long), (first, last) = pull.stops, (pull.lengths[0], pull.lengths[-1])
    L = np.linspace(first + _BEYOND * (short - first), last + _BEYOND * (long - last), _LENGTHS)
    P = np.linspace(0.0, pull.pressures[-1], _PRESSURES)

    def asked(ask: Callable[[float, float], float], L: np.ndarray, P: np.ndarray) -> np.ndarray:
        return np.array([[ask(one, at) for at in P.tolist()] for one in L.tolist()])

    force = asked(pull.force, L, P)
    true = asked(pull.force, 0.5 * (L[1:] + L[:-1]), 0.5 * (P[1:] + P[:-1]))
    straight = 0.25 * (force[1:, 1:] + force[:-1, 1:] + force[1:, :-1] + force[:-1, :-1])
    off = np.abs(straight - true)
    about = [
        *subject.about_table,
        f"errors of bilinear interpolation are up to {off.max():.2g} N in the middle of a cell",
        "model_force_N is the model force without clipping: negative where the muscle is slack",
        "the grid ends before the braid locks or the threads are straight: do not extrapolate from it",
    ]
    grid = {
        "length_m": L, "pressure_Pa": P, "force_N": force,
        "model_force_N": asked(pull.model_force, L, P),
        "stiffness_N_per_m": asked(pull.stiffness, L, P), "area_m2": asked(pull.area, L, P),
    }  # fmt: skip
    return grid, about


def _words(subject: Subject, comment: str, number: str, *, end: str = "") -> dict[str, Any]:
    """Return the substitutions shared by all table templates.

    Args:
        subject: muscle to export.
        comment: prefix for each line of the heading.
        number: format of a number, such as `R({})`.
        end: continuation after each line of numbers except the last.
    """
    table, pull = subject.table, subject.pull
    lines = functools.partial(numbers_in_lines, number=number, end=end)
    # Prevent the heading from opening or closing a C comment.
    about = [
        line.replace("/*", "/ *").replace("*/", "* /").replace("\\", "/")
        for line in subject.about_table
    ]
    limits = {
        "SHORTEST": pull.lengths[0], "LONGEST": pull.lengths[-1], "LOWEST": pull.pressures[0],
        "HIGHEST": pull.pressures[-1], "LIMIT": pull.pressure_limit, "STOP_SHORT": pull.stops[0],
        "STOP_LONG": pull.stops[1], "STOP_STIFFNESS": pull.stop[0], "STOP_ONSET": pull.stop[1],
        "SLACK": pull.slack_width,
    }  # fmt: skip
    return {
        "name": subject.identifier, "NAME": subject.identifier.upper(),
        "HEADING": "\n".join(f"{comment} {line}" for line in about),
        "LENGTHS": len(pull.lengths), "LENGTH_NODES": lines(pull.lengths),
        "PRESSURES": len(pull.pressures), "PRESSURE_NODES": lines(pull.pressures),
        "NODES": lines(itertools.chain(*itertools.chain(*pull.rows))), **limits,
        **{f"LENGTH_END_{k}": one for k, one in enumerate(table["length_ends_per_m"])},
        **{f"PRESSURE_END_{k}": one for k, one in enumerate(table["pressure_ends_per_Pa"])},
    }  # fmt: skip
