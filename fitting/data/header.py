"""The header of a force map: which quantity each column holds, and in which unit."""

import dataclasses
from collections.abc import Sequence

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS, factor, si_unit

from .force_data import COLUMNS

_SHARES = {"": 1.0, "_%": 0.01, "_percent": 0.01}
_CONTRACTIONS = {
    f"{quantity}{unit}": (quantity, size, unit.lstrip("_"))
    for quantity in ("contraction", "contraction_std")
    for unit, size in _SHARES.items()
}
"""Columns that stand for the length."""

_REQUIRED = ("force", "pressure", "length")
_LONGEST = 40  # characters of a cell in a message


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of a file.

    Attributes:
        quantity: one of `COLUMNS`, or contraction or contraction_std, whose length is not known.
        factor: multiplier of its numbers to SI.
        unit: as the header has it, "" for a fraction.
    """

    quantity: str
    factor: float
    unit: str = ""


def columns_of(header: Sequence[str]) -> list[Column]:
    """The columns of a header.

    Raises:
        InputError: a column that is not known, has no unit or is there twice, or one that is not
            there.

    >>> [column.quantity for column in columns_of(["force_N", "pressure_kPa", "contraction_%"])]
    ['force', 'pressure', 'contraction']
    """
    columns: list[Column] = []
    for name in header:
        column = _column(name)
        if column.quantity in [known.quantity for known in columns]:
            raise InputError(f"the quantity {column.quantity!r} has two columns; keep one")
        columns.append(column)
    given = {column.quantity for column in columns}
    for length, contraction in (("length", "contraction"), ("length_std", "contraction_std")):
        if {length, contraction} <= given:
            raise InputError(
                f"{length!r} and {contraction!r} say the same of a reading; keep one of the columns"
            )
    if "contraction_std" in given and "contraction" not in given:
        raise InputError("contraction_std is that of a contraction, and there is none")
    missing = [
        name
        for name in _REQUIRED
        if name not in given and not (name == "length" and "contraction" in given)
    ]
    if missing:
        raise InputError(
            f"no column for {' and '.join(missing)}; the header has "
            f"{', '.join(name[:_LONGEST] for name in header)} and must have force, pressure and "
            "length, each with its unit, as in pressure_kPa"
        )
    return columns


def _column(name: str) -> Column:
    if name in _CONTRACTIONS:
        return Column(*_CONTRACTIONS[name])
    quantity, _, unit = name.rpartition("_")
    if name in COLUMNS:
        raise InputError(
            f"column {name!r} has no unit; write for example "
            + " or ".join(f"{name}_{unit}" for unit in UNITS[COLUMNS[name]])
        )
    if quantity in {"contraction", "contraction_std"}:
        raise InputError(
            f"column {quoted(name)} has the unknown unit {unit!r}: a contraction is (L0 - L)/L0, "
            "contraction as a fraction or contraction_% in percent; lengths stand in a column "
            "such as length_mm"
        )
    if quantity not in COLUMNS:
        known = ", ".join(f"{key}_{si_unit(kind)}" for key, kind in COLUMNS.items())
        raise InputError(
            f"unknown column {quoted(name)}; known are, with any unit: {known}; and contraction "
            "or contraction_% in place of the length"
        )
    kind = COLUMNS[quantity]
    if unit not in UNITS[kind]:
        gauge = ", gauge" if kind == "pressure" else ""
        raise InputError(
            f"column {quoted(name)} has the unknown unit {quoted(unit)}; known units of {kind} "
            f"are: {', '.join(UNITS[kind])}{gauge}"
        )
    return Column(quantity, factor(unit, kind), unit)


def quoted(text: str) -> str:
    """A text as a message shows it: what is long is cut."""
    return repr(text if len(text) <= _LONGEST else text[:_LONGEST] + "...")
