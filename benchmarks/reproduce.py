"""The reference work's printed figures, computed: the code behind `famjax reproduce`.

Chambers 2021, chapters 2 and 4 to 7, from the inputs that the work prints; chapter 7's fits, on the
page alone, are of a synthetic reconstruction. The tables are those of `examples/chambers2021`. The
modules beside this one are loaded by plain name, so its folder must be on `sys.path`.
"""

import html
import itertools
import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path

import jax
import reconstruction  # first: it puts the folder of the chapters on `sys.path`

# isort: split
import chapter2_design
import chapter4_shape
import chapter5_braid
import chapter6_force
import chapter6_virtual_work
import chapter7_identification
from beside_print import Row, Table
from notes import NOT_COMPUTED, NOTES
from row import Case

from fitting.specimen import any_units

Progress = Callable[[int, int, str], None]
"""Called before each table with the number of those done, of all, and its name, and once at the end."""

CHAPTERS: tuple[tuple[str, tuple[Table, ...]], ...] = (
    ("chapter 2", chapter2_design.chapter.tables),
    ("chapter 4", chapter4_shape.chapter.tables),
    ("chapter 5", chapter5_braid.chapter.tables),
    ("chapter 6", chapter6_force.chapter.tables),
    ("virtual work", chapter6_virtual_work.chapter.tables),
    ("chapter 7", chapter7_identification.chapter.tables),
)

PAGE = "reproduce.html"
"""Name of the page's file."""


def reproduce(
    output: Path | None = None, progress: Progress | None = None, *, synthetic: bool = False
) -> list[Row]:
    """Every figure, in the order of the work; and the page where a folder is given.

    Args:
        output: folder for the page, created if missing; None writes nothing.
        progress: see `Progress`.
        synthetic: whether the page has the fits of the synthetic reconstruction too.

    Returns:
        The rows, without those of the reconstruction.

    Raises:
        RuntimeError: JAX is not in float64, in which equilibria are not found to the last digit.
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "the reproduction runs in float64: call jax.config.update('jax_enable_x64', True) first"
        )
    tables = [(f"{chapter}, {name}", table) for chapter, of in CHAPTERS for name, table in of]
    fits = reconstructed() if synthetic and output is not None else ()
    names = [*(name for name, _ in (*tables, *fits)), "done"]
    steps = itertools.count()

    def step() -> None:
        done = next(steps)
        if progress is not None:
            progress(done, len(names) - 1, names[done])

    def rows(of: Iterable[Table]) -> list[Row]:
        found = []
        for _, table in of:
            step()
            found += table()
        return found

    found, made = rows(tables), rows(fits)
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        draft = output / f"{PAGE}.part"  # so that the page is written whole or not at all
        draft.write_text(page(found, made), encoding="utf-8")
        os.replace(draft, output / PAGE)
    step()
    return found


def reconstructed() -> tuple[Table, ...]:
    """Chapter 7's tables of the SYNTHETIC reconstruction in the measured geometry."""
    data, shape = reconstruction.force_map(), reconstruction.measured_geometry()
    isobars = chapter7_identification.Isobars("SYNTHETIC", data, shape)  # in inch, psi and lbf
    return tuple(
        (title, any_units()(table)) for title, table in chapter7_identification.tables(isobars)
    )


_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:80rem;margin:2rem auto;padding:0 1rem;color:#222}
h2{margin:2.2rem 0 .3rem}table{border-collapse:collapse;font-size:.87rem}
td,th{padding:.12rem .7rem;text-align:right;border-bottom:1px solid #eee}
td:first-child,th:first-child,td:last-child,th:last-child{text-align:left}
tr.outside{background:#fde8e4}.within{color:#17702b}.outside .verdict{color:#a3200d;font-weight:600}
.note{color:#555}
nav{display:flex;flex-wrap:wrap;column-gap:.8rem}nav a{white-space:nowrap}
"""


def page(rows: list[Row], synthetic: list[Row]) -> str:
    """The page: what agrees, and the tables with their tolerances."""
    rows = sorted(rows, key=lambda row: _order(row.table))
    tables = {table: list(of) for table, of in itertools.groupby(rows, lambda row: row.table)}
    count = {
        verdict: sum(row.verdict == verdict for row in rows)
        for verdict in ("within", "outside", "misprint", "not published")
    }
    links = "".join(f'<a href="#{_anchor(t)}">{html.escape(t)}</a>' for t in tables)
    reasons = "".join(
        f"<li><b>{html.escape(t)}</b>: {html.escape(w)}</li>" for t, w in NOT_COMPUTED
    )
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        f"<title>The reference work reproduced</title><style>{_STYLE}</style>",
        "<h1>The reference work reproduced</h1><p>Chambers 2021, computed from the inputs that it ",
        "prints. Nothing is tuned to a figure. Each printed figure is compared once; its tolerance is ",
        "half a unit of its last digit and what is named beside it.</p>",
        f"<p><b>{count['within']}</b> figures within tolerance, <b>{count['outside']}</b> out of ",
        f"tolerance, <b>{count['misprint']}</b> misprints by the work's own other figures, ",
        f"<b>{count['not published']}</b> computed of which no published figure was given to us.</p>",
        f"<nav>{links}</nav><h2>Out of tolerance, and misprints</h2>",
        _table([row for row in rows if row.within is False], with_table=True),
        f"<h2>Not computed</h2><ul>{reasons}</ul>",
    ]
    for table, of in tables.items():
        title = f"Table {table}" if table.replace(".", "").isdigit() else f"Section {table}"
        notes = (f'<p class="note">{html.escape(note)}</p>' for t, note in NOTES if t == table)
        parts += [f'<h2 id="{_anchor(table)}">{html.escape(title)}</h2>', *notes, _table(of)]
    if synthetic:
        parts += [
            '<h2 id="synthetic">Chapter 7, on a SYNTHETIC reconstruction</h2><p class="note">The tested ',
            "isobars are not printed. These are fits of isobars that were chosen so that their fits ",
            "leave errors like those printed: that they do says that such isobars exist, and nothing ",
            "more.</p>",
            _table(synthetic, with_table=True),
        ]
    return "".join(parts)


def _order(table: str) -> tuple[int, int, str]:
    """By chapter and number; sections without a number after their chapter's tables."""
    chapter, _, number = table.partition(".")
    if number.isdigit():
        return int(chapter), int(number), ""
    digit = table[:1]
    return (int(digit) if digit.isdigit() else 99), 99, table


def _anchor(table: str) -> str:
    return "table-" + "".join(c if c.isalnum() else "-" for c in table)


def _table(rows: list[Row], *, with_table: bool = False) -> str:
    names = ("entry", "published", "computed", "difference", "tolerance", "unit", "verdict",
             "the tolerance is")  # fmt: skip
    head = "".join(f"<th>{name}</th>" for name in names)
    lines = []
    for row in rows:
        entry = html.escape(f"{row.table}: {row.entry}" if with_table else row.entry)
        numbers = (
            "" if value is None else f"{value:{form}}"
            for value, form in (
                (row.published, ".6g"), (row.computed, ".6g"), (row.difference, "+.3g"),
                (row.tolerance, ".3g"),
            )
        )  # fmt: skip
        cells = "".join(f"<td>{cell}</td>" for cell in (entry, *numbers, row.unit.strip("1")))
        verdict = f'<td class="verdict">{row.verdict}</td><td>{html.escape(row.reason)}</td>'
        lines.append(f'<tr class="{row.verdict}">{cells}{verdict}</tr>')
    return f"<table><tr>{head}</tr>{''.join(lines)}</table>"


NUMBERED = ("2.1", "2.2", "2.3", "2.4", "2.5", "4.2", "4.3", "5.1", "5.2",
            *(f"6.{n}" for n in range(1, 10)), "6.11", "6.12")  # fmt: skip
"""Tables of the work that follow from what it prints, by its own numbers."""


def printed_figures(_: Case) -> dict[str, float]:
    """Printed figures of each chapter that ours are not within tolerance of, and tables without rows."""
    rows = reproduce()
    found = {
        f"chapter {n}, figures out of tolerance": float(
            sum(row.verdict == "outside" for row in rows if row.table.startswith(str(n)))
        )
        for n in (2, 4, 5, 6, 7)
    }
    tables = [[row for row in rows if row.table == number] for number in NUMBERED]
    finite = [bool(of) and all(math.isfinite(row.computed) for row in of) for of in tables]
    return found | {"tables without a row, or with one that is no number": finite.count(False)}
