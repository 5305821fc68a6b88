"""The reference work's printed figures, computed: the code behind `famjax reproduce`.

Chambers 2021, chapters 2, 4, 5 and 6, from the inputs that the work prints. The modules beside this
one are loaded by plain name, so that its folder must be on `sys.path`.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import chambers_braid
import chambers_design
import chambers_force
import chambers_identification
import chambers_shape
import chambers_virtual_work
import jax
from chambers_notes import NOT_COMPUTED, NOTES
from chambers_reference import Row

Progress = Callable[[int, int, str], None]
"""Called with the number of chapters done, that of all, and the name of the next one."""

CHAPTERS: tuple[tuple[str, ModuleType], ...] = (
    ("chapter 2: design", chambers_design),
    ("chapter 4: shape", chambers_shape),
    ("chapter 5: braid", chambers_braid),
    ("chapter 6: forces", chambers_force),
    ("virtual work", chambers_virtual_work),
)


def reproduce(output: Path | None = None, progress: Progress | None = None) -> list[Row]:
    """Every figure, in the order of the work, and the page where a folder is given.

    Args:
        output: folder for the page, made if need be; None writes nothing.
        progress: see `Progress`.

    Returns:
        The rows.

    Raises:
        RuntimeError: JAX is not in float64, in which equilibria are not found to the last digit.
    """
    found = list(_rows(progress))
    if output is not None:
        from chambers_page import write  # noqa: PLC0415 -- matplotlib, only where a page is wanted

        write(output, found)
    return found


def rows(progress: Progress | None = None) -> list[dict[str, Any]]:
    """Every figure: table, entry, published, computed, unit, tolerance, within; for JSON.

    `published`, `tolerance` and `within` are None where the figure was not given to us.
    """
    return [row.as_dict() for row in _rows(progress)]


def synthetic_fits() -> list[Row]:
    """Chapter 7's printed errors beside fits of the SYNTHETIC reconstruction: no verdicts."""
    return chambers_identification.rows()


def write_page(
    folder: Path, found: list[Row] | None = None, synthetic: list[Row] | None = None
) -> list[Path]:
    """The page for people, one self-contained file.

    Args:
        folder: made if need be.
        found: rows of `reproduce`; None computes them.
        synthetic: rows of `synthetic_fits`; None leaves them out.

    Returns:
        The files written.
    """
    from chambers_page import write  # noqa: PLC0415 -- matplotlib, only where a page is wanted

    return write(folder, list(_rows(None)) if found is None else found, synthetic)


def notes() -> list[dict[str, str]]:
    """Remarks on tables: how they were read, and why rows are out of tolerance."""
    return [{"table": table, "note": note} for table, note in NOTES]


def not_computed() -> list[dict[str, str]]:
    """Figures that cannot be computed from what the work prints, and why."""
    return [{"table": table, "reason": reason} for table, reason in NOT_COMPUTED]


def _rows(progress: Progress | None) -> Iterator[Row]:
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "the reproduction runs in float64: call jax.config.update('jax_enable_x64', True) first"
        )
    for done, (name, chapter) in enumerate(CHAPTERS):
        if progress is not None:
            progress(done, len(CHAPTERS), name)
        yield from chapter.rows()
    if progress is not None:
        progress(len(CHAPTERS), len(CHAPTERS), "done")
