"""Promises about the figures that the reference work prints."""

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
        return sum(row.within is False for row in of)

    return measure


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
        for chapter in ("2", "4", "5", "6")
    ),
    shown(3, "roots of the elastic braid", "pytest tests/famjax -k elastic",
          "relative error of a derivative", 1e-6),
    shown(3, "quadrature", "pytest tests/famjax -k quadrature", "relative error", 1e-8),
)  # fmt: skip
"""Issue 3."""
