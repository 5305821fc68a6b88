"""Promises about the figures that the reference work prints."""

import math
from collections.abc import Callable
from typing import Any

from promise import Case, Promise, shown


def out_of_tolerance(chapter: str) -> Callable[[Case], float]:
    """Printed figures of a chapter of the reference work that ours are not within tolerance of."""

    def measure(case: Case) -> float:
        rows = case.once("reproduce", _reproduced)
        of = [row for row in rows if row.table.startswith(chapter) and row.within is not None]
        if not of:
            raise RuntimeError(f"no printed figure belongs to chapter {chapter}")
        return sum(row.verdict == "outside" for row in of)

    return measure


NUMBERED = ("2.1", "2.2", "2.3", "2.4", "2.5", "4.2", "4.3", "5.1", "5.2",
            *(f"6.{n}" for n in range(1, 10)), "6.11", "6.12")  # fmt: skip
"""Tables of the work that follow from what it prints, by its own numbers."""


def rows_of_tables(case: Case) -> float:
    """Tables of the work of which no row, or one that is not finite, is computed."""
    rows = case.once("reproduce", _reproduced)
    return sum(
        not of or not all(math.isfinite(row.computed) for row in of)
        for of in ([row for row in rows if row.table == number] for number in NUMBERED)
    )


def _reproduced() -> list[Any]:
    import jax  # noqa: PLC0415
    import reproduce  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    return reproduce.reproduce()


TABLES: tuple[Promise, ...] = (
    *(
        Promise(3, f"printed figures, chapter {chapter}", out_of_tolerance(chapter),
                "famjax reproduce", "reference work", "figures with a tolerance",
                "figures out of tolerance", 0.0)
        for chapter in ("2", "4", "5", "6", "7")
    ),
    Promise(3, "rows of the work's tables that are computed", rows_of_tables,
            "famjax reproduce --json", "reference work", "tables 2.1 to 2.5, 4.2, 4.3, 5.1, 5.2, 6.1 "
            "to 6.9, 6.11, 6.12", "tables without a row, or with one that is no number", 0.0),
    shown(3, "roots of the elastic braid", "pytest tests/famjax -k elastic",
          "relative error of a derivative", 1e-6),
    shown(3, "quadrature", "pytest tests/famjax -k quadrature", "relative error", 1e-8),
)  # fmt: skip
"""Issue 3."""
