"""Tables of the page that a terminal does not show: the specimen, and correlations."""

import dataclasses

import numpy as np

from famjax.boundary.units import from_si, unit_system

from ..evidence.gathered import Table
from ..result import Identification
from .fit_file import correlations

_TOLD = 0.9
"""Correlation from which two parameters are hard to tell apart."""


def specimen_table(result: Identification, system: str) -> Table:
    """What was known of the muscle, and what was measured on it."""
    data, units = result.data, unit_system(system)

    def shown(value: float, kind: str) -> str:
        return f"{from_si(float(value), units[kind], kind):.5g}"

    rows: list[tuple[str, ...]] = []
    for name, value in dataclasses.asdict(data.specimen).items():
        title = name.replace("_", " ")
        if value is None:
            rows.append((title, "not given", ""))
        elif isinstance(value, bool):
            rows.append((title, "yes" if value else "no", ""))
        elif isinstance(value, str):
            rows.append((title, value, ""))
        else:
            rows.append((title, shown(value, "length"), units["length"]))
    for name in ("length", "pressure", "force"):
        low, high = getattr(data, name).min(), getattr(data, name).max()
        rows.append(
            (f"{name}s measured", f"{shown(low, name)} to {shown(high, name)}", units[name])
        )
    rows.append(("readings", f"{data.force.size}, of which {data.loaded.sum()} pull", ""))
    return "Specimen and readings", ("entry", "value", "unit"), rows


def correlation_tables(result: Identification) -> list[Table]:
    """Correlations of the parameters by linear theory, each of two named once; none for one."""
    names, matrix = correlations(result)
    if len(names) < 2:
        return []
    rows = [
        (name, *(f"{value:+.2f}" for value in line[:k]), *("" for _ in names[k:-1]))
        for k, (name, line) in enumerate(zip(names, matrix, strict=True))
        if k
    ]
    strong = int((np.abs(matrix[np.triu_indices(len(names), 1)]) > _TOLD).sum())
    title = f"Correlations by linear theory ({strong} beyond +-{_TOLD:g})"
    return [(title, ("", *names[:-1]), rows)]
