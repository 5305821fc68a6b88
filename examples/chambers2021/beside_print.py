"""Compare computed figures with those printed in the dissertation, and print the tables in a chapter.

All values are in inches, psi, lbf and degrees, as printed. The printed figures come from
`benchmarks/reference/chambers2021.toml`, which was transcribed from Chambers 2021.
"""

import dataclasses
import functools
import itertools
import math
import tomllib
from collections.abc import Callable, Iterable
from decimal import Decimal
from pathlib import Path
from typing import Any

import jax
from notes import NOTES

_MOST = 12
"""Number of rows shown for a table without printed figures."""

_REFERENCE = Path(__file__).resolve().parents[2] / "benchmarks/reference/chambers2021.toml"


@dataclasses.dataclass(frozen=True)
class Row:
    """One figure, as published and as computed.

    Attributes:
        table: table in the reference work, such as "6.11", or the topic of the figure.
        entry: quantity and conditions.
        computed: computed value, in `unit`.
        unit: "in", "psi", "1" for a dimensionless number, and so on.
        published: printed value; None if it is not available.
        tolerance: largest difference that counts as agreement, in `unit`. None if `published` is None, or
            if the computed value comes from a twin or a reconstruction, which need not agree.
        reason: contributions to the tolerance.
        key: location of the published figure in the reference file, unique among all rows.
        misprint: True if the reference file marks the published figure as a misprint.
    """

    table: str
    entry: str
    computed: float
    unit: str
    published: float | None = None
    tolerance: float | None = None
    reason: str = ""
    key: str = ""
    misprint: bool = False

    @property
    def difference(self) -> float | None:
        """Computed minus published; None if nothing was published."""
        return None if self.published is None else self.computed - self.published

    @property
    def within(self) -> bool | None:
        """True if the difference is within the tolerance, apart from binary rounding."""
        if self.difference is None or self.tolerance is None:
            return None
        return bool(abs(self.difference) <= self.tolerance * (1 + 1e-9))

    @property
    def verdict(self) -> str:
        """Result in words: within, outside, misprint, no verdict or not published."""
        if self.within is None:
            return "not published" if self.published is None else "no verdict"
        return "within" if self.within else "misprint" if self.misprint else "outside"

    def as_dict(self) -> dict[str, Any]:
        """Return the row as a dictionary, for `famjax reproduce --json`."""
        names = ("table", "entry", "published", "computed", "unit", "tolerance", "within",
                 "verdict", "reason")  # fmt: skip
        return {name: getattr(self, name) for name in names}


def beside(
    table: str, entry: str, computed: float, unit: str, key: str, spread: float = 0.0, why: str = "",
    *, misprint: bool = False,
) -> Row:  # fmt: skip
    """Return a row for a printed figure, with a tolerance based on its rounding.

    Args:
        table: table in the reference work; see `Row`.
        entry: quantity and conditions.
        computed: computed value, in `unit`.
        unit: unit of both values.
        misprint: True if the reference file marks the figure as a misprint.
        key: location of the printed figure in the reference file, such as "elastic_braid.D_in.0".
        spread: tolerance in addition to half a unit in the last printed digit, in `unit`.
        why: reason for the additional tolerance.
    """
    at: Any = _as_written()
    for part in key.split("."):
        at = at[int(part) if isinstance(at, list) else part]
    figure = Decimal(at)
    half = 0.5 * 10.0 ** int(figure.as_tuple().exponent)
    reason = "half a unit in the last digit" + (f", and {why}" if why else "")
    return Row(
        table, entry, float(computed), unit, float(figure), half + spread, reason, key, misprint
    )


Table = tuple[str, Callable[[], list[Row]]]
"""Title of a table and the function that computes its rows."""


@functools.cache
def printed() -> dict[str, Any]:
    """Return the figures in the reference file, whose comments explain them."""
    return tomllib.loads(_REFERENCE.read_text(encoding="utf-8"))


@functools.cache
def _as_written() -> dict[str, Any]:
    """Return the figures as decimals, which preserve the last printed digit."""
    return tomllib.loads(_REFERENCE.read_text(encoding="utf-8"), parse_float=Decimal)


class Chapter:
    """The tables in one chapter, in the order of the reference work.

    In a script or notebook, each table is computed and shown where it is defined; an imported chapter
    only stores the tables.
    """

    def __init__(self, module: str) -> None:
        self.shown = module == "__main__"
        self._tables: list[Table] = []
        if self.shown:  # equilibria need float64 for all printed digits
            jax.config.update("jax_enable_x64", True)

    @property
    def tables(self) -> tuple[Table, ...]:
        """Titles of the chapter's tables, and the functions that compute them."""
        return tuple(self._tables)

    def table(self, title: str) -> Callable[[Callable[[], list[Row]]], Callable[[], list[Row]]]:
        """Register a function that computes the rows of a table from printed data."""

        def keep(compute: Callable[[], list[Row]]) -> Callable[[], list[Row]]:
            self._tables.append((title, compute))
            if self.shown:
                rows = compute()
                _print(title, _lines(rows, _MOST), _remarks(rows))
            return compute

        return keep

    def show(self, title: str, rows: Iterable[Row]) -> None:
        """Print all rows of a table that was computed for the twin, in a script or notebook."""
        _print(title, _lines(list(rows)))


def _print(title: str, *lines: list[str]) -> None:
    print(f"\n{title[0].upper()}{title[1:]}", *itertools.chain(*lines), sep="\n")


def _lines(rows: list[Row], most: int | None = None) -> list[str]:
    """Return all rows, or only those with printed figures, or else the first few."""
    shown = rows
    if most is not None:
        shown = [row for row in rows if row.published is not None] or rows[:most]
    wide = max((len(row.entry) for row in shown), default=0)
    lines = [f"  {'':{wide}}  {'published':>10}  {'computed':>10}"] + [
        f"  {row.entry:{wide}}  {_number(row.published):>10}  {_number(row.computed):>10} "
        f"{row.unit.strip('1')} {row.verdict.upper() if row.within is False else ''}".rstrip()
        for row in shown
    ]
    more = len(rows) - len(shown)
    return [*lines, f"  and {more} more rows without printed figures"] if more else lines


def _number(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:.5g}"


def _remarks(rows: list[Row]) -> list[str]:
    of = {row.table for row in rows}
    return [f"  Note on {table}: {note}" for table, note in NOTES if table in of]
