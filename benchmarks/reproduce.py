"""The reference work's printed figures, computed: the code behind `famjax reproduce`.

Chambers 2021, chapters 2, 4, 5 and 6, from the inputs that the work prints, and on the page chapter
7 on a synthetic reconstruction. The tables are those of `examples/chambers2021`, a module for each
chapter. The modules beside this one are loaded by plain name, so that its folder must be on `sys.path`.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import chambers_examples  # noqa: F401 -- where the chapters are found
import chapter2_design
import chapter4_shape
import chapter5_braid
import chapter6_force
import chapter6_virtual_work
import chapter7_identification
import jax
import specimen
from beside_print import Row, Table
from notes import NOT_COMPUTED, NOTES

Progress = Callable[[int, int, str], None]
"""Called before each table and figure, with the number of those done, of all, and its name, and once
at the end."""

CHAPTERS: tuple[tuple[str, tuple[Table, ...]], ...] = (
    ("chapter 2", chapter2_design.chapter.tables),
    ("chapter 4", chapter4_shape.chapter.tables),
    ("chapter 5", chapter5_braid.chapter.tables),
    ("chapter 6", chapter6_force.chapter.tables),
    ("virtual work", chapter6_virtual_work.chapter.tables),
)

PAGE = "reproduce.html"
"""Name of the page's file."""


def reproduce(
    output: Path | None = None, progress: Progress | None = None, *, synthetic: bool = False
) -> list[Row]:
    """Every figure, in the order of the work, and the page where a folder is given.

    Args:
        output: folder for the page, made if need be; None writes nothing.
        progress: see `Progress`.
        synthetic: whether the page has chapter 7 too, see `synthetic_fits`.

    Returns:
        The rows, without those of chapter 7.

    Raises:
        RuntimeError: JAX is not in float64, in which equilibria are not found to the last digit.
    """
    _check_float64()
    steps = _Steps(progress)
    tables = [(f"{chapter}, {name}", table) for chapter, of in CHAPTERS for name, table in of]
    steps.total = len(tables)
    if output is None:
        found = steps.rows(tables)
    else:
        from chambers_page import FIGURES, write  # noqa: PLC0415 -- matplotlib, only for a page

        fits = reconstructed() if synthetic else ()
        steps.total += len(fits) + len(FIGURES)
        found = steps.rows(tables)
        write(output / PAGE, found, steps.rows(fits), steps.begin)
    steps.end()
    return found


def rows(progress: Progress | None = None) -> list[dict[str, Any]]:
    """Every figure: table, entry, published, computed, unit, tolerance, within; for JSON.

    `published`, `tolerance` and `within` are None where the figure was not given to us.
    """
    return [row.as_dict() for row in reproduce(None, progress)]


def synthetic_fits() -> list[Row]:
    """Chapter 7's printed errors beside fits of the SYNTHETIC reconstruction: no verdicts."""
    _check_float64()
    return _Steps(None).rows(reconstructed())


def reconstructed() -> tuple[Table, ...]:
    """Chapter 7's tables of the SYNTHETIC reconstruction in the measured geometry."""
    from identification_problem import GEOMETRY, force_map  # noqa: PLC0415 -- not for --json

    shape = specimen.geometries()[GEOMETRY]
    return chapter7_identification.tables(
        chapter7_identification.Isobars("SYNTHETIC", force_map(), shape)
    )


def write_page(
    folder: Path, found: list[Row] | None = None, synthetic: list[Row] | None = None
) -> list[Path]:
    """The page `PAGE`, one self-contained file.

    Args:
        folder: made if need be.
        found: rows of `reproduce`; None computes them.
        synthetic: rows of `synthetic_fits`; None leaves them out.

    Returns:
        The files written.
    """
    from chambers_page import write  # noqa: PLC0415 -- matplotlib, only for a page

    return write(folder / PAGE, reproduce() if found is None else found, synthetic)


def notes() -> list[dict[str, str]]:
    """Remarks on tables: how they were read, and why rows are out of tolerance."""
    return [{"table": table, "note": note} for table, note in NOTES]


def not_computed() -> list[dict[str, str]]:
    """Figures that cannot be computed from what the work prints, and why."""
    return [{"table": table, "reason": reason} for table, reason in NOT_COMPUTED]


class _Steps:
    """How far the reproduction is."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._begun: list[str] = []
        self.total = 0

    def rows(self, tables: Iterable[Table]) -> list[Row]:
        """The rows of all tables, each a step."""
        found = []
        for name, table in tables:
            self.begin(name)
            found += table()
        return found

    def begin(self, name: str) -> None:
        """The step before is done, and this one begins."""
        self._begun.append(name)
        self._tell(len(self._begun) - 1, name)

    def end(self) -> None:
        """All is done."""
        self._tell(self.total, "done")

    def _tell(self, done: int, name: str) -> None:
        if self._progress is not None:
            self._progress(done, self.total, name)


def _check_float64() -> None:
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "the reproduction runs in float64: call jax.config.update('jax_enable_x64', True) first"
        )
