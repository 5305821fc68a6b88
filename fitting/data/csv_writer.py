"""A force map as a CSV file that `read_csv` reads back."""

import dataclasses
from pathlib import Path

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import factor, unit_system

from ..arguments import check_path
from .force_data import ForceData, check_maps

_WRITTEN_AS = {"wall_thickness": "wall_thickness", "bladder_diameter": "embedded"}
"""Field of a specimen that an assumption has filled in, by what was not said."""


def csv_text(data: ForceData, system: str = "si") -> str:
    """The text of the file: specimen and notes in comment lines, then one row per reading.

    Wall and place of the braid are left out where they were assumed: who reads the file assumes them too.

    Args:
        data: the map.
        system: "si", which reads back to the same bits, "metric" or "us".

    >>> from fitting import load_bundled
    >>> lines = csv_text(load_bundled("DMSP-10-250")).splitlines()
    >>> next(line for line in lines if not line.startswith("#"))
    'force_N,pressure_Pa,length_m'
    """
    units = unit_system(system)
    lines = [f"# note: {note}" for note in data.notes]
    assumed = {_WRITTEN_AS[name] for name in data.assumed if name in _WRITTEN_AS}
    for key, value in dataclasses.asdict(data.specimen).items():
        if key in assumed:
            continue
        if isinstance(value, str):
            lines.append(f"# specimen: {key} = {value}")
        elif isinstance(value, bool):
            lines.append(f"# specimen: {key} = {str(value).lower()}")
        elif value is not None:
            scaled = float(value) / factor(units["length"], "length")
            lines.append(f"# specimen: {key}_{units['length']} = {scaled!r}")
    if data.force_limit is not None:
        limit = float(data.force_limit) / factor(units["force"], "force")
        lines.append(f"# specimen: force_limit_{units['force']} = {limit!r}")
    for name, kind in (("pressure_tolerance", "pressure"), ("length_tolerance", "length")):
        if (tolerance := getattr(data, name)) is not None:
            scaled = float(tolerance) / factor(units[kind], kind)
            lines.append(f"# level: {name}_{units[kind]} = {scaled!r}")
    columns = data.columns(system)
    lines.append(",".join(columns))
    rows = np.stack(list(columns.values()), axis=1).tolist()
    lines += [",".join(map(repr, row)) for row in rows]
    return "\n".join(lines) + "\n"


def write_csv(data: ForceData, path: str | Path, system: str = "si") -> Path:
    """Write a force map, with its specimen and notes.

    Args:
        data: the map.
        path: the file; one that is there is replaced.
        system: "si", which `read_csv` reads back to the same bits, "metric" or "us".

    Returns:
        The path.

    Raises:
        InputError: an unknown unit system, or a file that cannot be written.
    """
    check_maps(data)
    path, text = check_path("path", path), csv_text(data, system)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
    return path
