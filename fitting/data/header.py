"""The header of a force map: which quantity each column holds, and in which unit."""

import dataclasses
import re
from collections.abc import Sequence

from famjax.boundary.errors import InputError
from famjax.boundary.near import meant
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
_BRACKETED = re.compile(r"\s*([A-Za-z][A-Za-z _]*?)\s*(?:[(\[]\s*([^()\[\]]*?)\s*[)\]]|\s(\S+))\s*")
"""A quantity, then its unit in brackets or after a space."""

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
    """The columns of a header: a quantity and its unit, as in `force_N`, `Force [N]` or `Force (N)`.

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


def _plain(name: str) -> str:
    """A column's name as this program writes it, from one with its unit in brackets or after a space.

    In any case: `Pressure (psi)`, `Force [N]`, `Length mm`. What is not of this form stays.

    >>> [_plain(one) for one in ("Pressure (PSI)", "Force [N]", "Contraction [%]", "Force")]
    ['pressure_psi', 'force_N', 'contraction_%', 'Force']
    """
    match = _BRACKETED.fullmatch(name)
    if match is None:
        stem, _, unit = name.rpartition("_")
    else:
        stem, unit = match[1], match[2] or match[3] or ""
    quantity = "_".join(stem.lower().split())
    if quantity in {"contraction", "contraction_std"}:
        return quantity if unit in {"", "-"} else f"{quantity}_{unit.lower()}"
    if quantity not in COLUMNS:
        return name
    return f"{quantity}_{_unit(unit, COLUMNS[quantity])}"


def _unit(text: str, kind: str) -> str:
    """A unit in any case; m and M are of different size, and are not taken for one another."""
    if text in UNITS[kind]:
        return text
    alike = [
        one for one in UNITS[kind]
        if one.lower() == text.lower() and (one[0] == text[0] or text[0] not in "mM")
    ]  # fmt: skip
    return alike[0] if len(alike) == 1 else text


def _column(given: str) -> Column:
    name = _plain(given)
    if name in _CONTRACTIONS:
        return Column(*_CONTRACTIONS[name])
    quantity, _, unit = name.rpartition("_")
    if name.lower() in COLUMNS:
        plain = name.lower()
        raise InputError(
            f"column {given!r} has no unit; write for example "
            + " or ".join(f"{plain}_{unit}" for unit in UNITS[COLUMNS[plain]])
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
            f"unknown column {quoted(given)}; known are, with any unit: {known}; and contraction "
            f"or contraction_% in place of the length{_meant(name)}"
        )
    kind = COLUMNS[quantity]
    if unit not in UNITS[kind]:
        gauge = ", gauge" if kind == "pressure" else ""
        raise InputError(
            f"column {quoted(given)} has the unknown unit {quoted(unit)}; known units of {kind} "
            f"are: {', '.join(UNITS[kind])}{gauge}{meant(unit, UNITS[kind])}"
        )
    return Column(quantity, factor(unit, kind), unit)


def _meant(name: str) -> str:
    """The nearest column of any unit."""
    known = [f"{key}_{unit}" for key, kind in COLUMNS.items() for unit in UNITS[kind]]
    return meant("_".join(re.split(r"[\s()\[\]_]+", name.strip(" )]"))), [*known, *_CONTRACTIONS])


def quoted(text: str) -> str:
    """A text as a message shows it: what is long is cut."""
    return repr(text if len(text) <= _LONGEST else text[:_LONGEST] + "...")
