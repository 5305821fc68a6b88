"""The page: what agrees, the tables side by side, the figures redrawn."""

import base64
import html
import io
import itertools
import os
from collections.abc import Callable
from pathlib import Path

from beside_print import Row
from chambers_figures import FIGURES
from matplotlib.figure import Figure
from notes import NOT_COMPUTED, NOTES

_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem;color:#222}
h2{margin:2.2rem 0 .3rem}table{border-collapse:collapse;font-size:.87rem}
td,th{padding:.12rem .7rem;text-align:right;border-bottom:1px solid #eee}
td:first-child,th:first-child{text-align:left}.out{background:#fde8e4}.in{color:#17702b}
.bad{color:#a3200d;font-weight:600}.none{color:#888}img{max-width:100%}figure{margin:1.5rem 0}
figcaption,.note{color:#555}nav{display:flex;flex-wrap:wrap;column-gap:.8rem}
nav a{white-space:nowrap}
"""


def write(
    path: Path,
    rows: list[Row],
    synthetic: list[Row] | None = None,
    begin: Callable[[str], None] | None = None,
) -> list[Path]:
    """The page; written whole or not.

    Args:
        path: of the page; its folder is made if need be.
        rows: published beside computed.
        synthetic: fits of the SYNTHETIC reconstruction beside the printed errors, without verdicts.
        begin: called with the name of each figure before it is drawn.

    Returns:
        The files written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".html.part")
    draft.write_text(_page(rows, synthetic or [], begin), encoding="utf-8")
    os.replace(draft, path)
    return [path]


def _page(rows: list[Row], synthetic: list[Row], begin: Callable[[str], None] | None) -> str:
    tables = {
        table: list(group)
        for table, group in itertools.groupby(
            sorted(rows, key=lambda row: _order(row.table)), lambda row: row.table
        )
    }
    within = sum(row.within is True for row in rows)
    out = [row for row in rows if row.within is False]
    silent = sum(row.published is None for row in rows)
    links = "".join(f'<a href="#{_anchor(t)}">{html.escape(t)}</a>' for t in tables)
    return "".join(
        [
            '<!doctype html><html lang="en"><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width">',
            f"<title>The reference work reproduced</title><style>{_STYLE}</style>",
            "<h1>The reference work reproduced</h1>",
            "<p>Chambers 2021, chapters 2, 4, 5 and 6, computed from the inputs that it prints. ",
            "Nothing is tuned to a figure; what differs by more than its tolerance is shown so.</p>",
            f"<p><b>{within}</b> figures within tolerance, <b>{len(out)}</b> out of tolerance, ",
            f"<b>{silent}</b> computed of which no published figure was given to us. ",
            "A published figure that can be read in two ways stands in two rows.</p>",
            f"<nav>{links}</nav>",
            "<h2>Out of tolerance</h2>",
            _table(out, with_table=True),
            _not_computed(),
            "<h2>Figures</h2>",
            *(_figure(caption, draw, begin) for caption, draw in FIGURES.items()),
            *(_section(table, group) for table, group in tables.items()),
            _synthetic(synthetic) if synthetic else "",
        ]
    )


def _order(table: str) -> tuple[int, int, str]:
    """By chapter and number; sections without a number after their chapter's tables."""
    chapter, _, number = table.partition(".")
    if number:
        return int(chapter), int(number), ""
    digit = table.partition(",")[0]
    return (int(digit) if digit.isdigit() else 99), 99, table


def _anchor(table: str) -> str:
    return "table-" + "".join(c if c.isalnum() else "-" for c in table)


def _section(table: str, rows: list[Row]) -> str:
    title = f"Table {table}" if table.replace(".", "").isdigit() else f"Section {table}"
    remarks = "".join(f'<p class="note">{html.escape(n)}</p>' for t, n in NOTES if t == table)
    heading = f'<h2 id="{_anchor(table)}">{html.escape(title)}</h2>'
    return heading + remarks + _table(rows, with_table=False)


def _synthetic(rows: list[Row]) -> str:
    return (
        '<h2 id="synthetic">Chapter 7, on a SYNTHETIC reconstruction</h2><p class="note">The tested '
        "isobars are not printed. These are fits of isobars that were made up from the printed blocked "
        "forces, free contractions and coefficients; their hysteresis, noise and the width of their "
        "steep start are assumed. That the errors resemble those that the work found on its own data "
        "says that the reconstruction is consistent with them, and nothing more.</p>"
        + _table(rows, with_table=True)
    )


def _table(rows: list[Row], *, with_table: bool) -> str:
    names = ("published", "computed", "difference", "tolerance", "unit", "verdict")
    head = "".join(f"<th>{name}</th>" for name in ("entry", *names))
    return f"<table><tr>{head}</tr>{''.join(_line(row, with_table) for row in rows)}</table>"


def _line(row: Row, with_table: bool) -> str:
    verdict, kind = {
        True: ("within", "in"),
        False: ("out", "bad"),
        None: ("not published" if row.published is None else "no verdict", "none"),
    }[row.within]
    cells = (
        _number(row.published),
        _number(row.computed),
        _number(row.difference, sign=True),
        _number(row.tolerance),
        row.unit if row.unit != "1" else "",
    )
    entry = html.escape(f"{row.table}: {row.entry}" if with_table else row.entry)
    body = "".join(f"<td>{cell}</td>" for cell in cells)
    shade = ' class="out"' if row.within is False else ""
    return f'<tr{shade}><td>{entry}</td>{body}<td class="{kind}">{verdict}</td></tr>'


def _number(value: float | None, *, sign: bool = False) -> str:
    if value is None:
        return ""
    digits = 3 if sign else 6
    return f"{value:+.{digits}g}" if sign else f"{value:.{digits}g}"


def _not_computed() -> str:
    lines = "".join(
        f"<li><b>{html.escape(table)}</b>: {html.escape(why)}</li>" for table, why in NOT_COMPUTED
    )
    return f"<h2>Not computed</h2><ul>{lines}</ul>"


def _figure(caption: str, draw: Callable[[], Figure], begin: Callable[[str], None] | None) -> str:
    if begin is not None:
        begin(f"figure: {draw.__name__.replace('_', ' ')}")
    stream = io.BytesIO()
    draw().savefig(stream, format="svg", metadata={"Date": None})
    data = base64.b64encode(stream.getvalue()).decode()
    text = html.escape(caption)
    return (
        f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )
