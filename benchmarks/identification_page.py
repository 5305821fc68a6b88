"""The page of the identification benchmark: times, accuracy beside them, ratios and the limit."""

import html
import itertools
import math
import os
import platform
from pathlib import Path
from typing import Any

_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem;color:#222}
h2{margin:2rem 0 .3rem}table{border-collapse:collapse;font-size:.87rem}
td,th{padding:.15rem .7rem;text-align:right;border-bottom:1px solid #eee}
td:first-child,th:first-child,td:last-child,th:last-child{text-align:left}
.ours{background:#e9f5ec}.bad{color:#a3200d;font-weight:600}.note{color:#555}
"""

EXACT = "this project, constraints exact between stations"
"""The solver's name of the line whose constraints hold everywhere on a path."""

TARGETS = (
    ("48 fits, sum of squares", "SLSQP, exact gradients", 150.0),
    ("48 fits, sum of squares", "SLSQP, finite differences", 1000.0),
    ("48 fits, sum of squares", "Clarabel, called directly", 10.0),
    ("48 fits, mean rmse", "SLSQP, exact gradients", 80.0),
    ("10000 bootstrap programmes of four coefficients", "Clarabel, called directly", 50.0),
    ("10000 programmes of a law that softens", "Clarabel, called directly", 50.0),
)
"""Task, solver and the ratio that was asked for."""

FLOPS = 2500
"""Floating-point operations of one programme of four coefficients under 17 rows.

A step of the walk takes 2 m n for the slacks, 4 n^2 for the image of a normal, 2 n^2 for that of a
leaving row and 4 n^2 for the update, with m = 19 and n = 4 about 320; 3 steps and the final search
for a violated row, two refinements of 12 n^2 each, Cholesky and its inverse, 2/3 n^3: in all 2500.
"""


def write(folder: Path, lines: list[Any], peak: float) -> list[Path]:
    """The page `identification.html` in the folder, created if missing.

    Args:
        folder: for the page.
        lines: of `identification.run`.
        peak: measured peak [GFlop/s] of the machine.

    Returns:
        The files written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "identification.html"
    draft = path.with_suffix(".html.part")
    draft.write_text(page(lines, peak), encoding="utf-8")
    os.replace(draft, path)
    return [path]


def page(lines: list[Any], peak: float) -> str:
    """The page as text."""
    tables = "".join(
        f"<h2>{html.escape(task)}</h2>{_table(list(group))}"
        for task, group in itertools.groupby(lines, key=lambda line: line.task)
    )
    return "".join(
        [
            '<!doctype html><html lang="en"><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width">',
            f"<title>Identification: speed and accuracy</title><style>{_STYLE}</style>",
            "<h1>Identification: speed and accuracy</h1>",
            "<p>The 48 fits of chapter 7 of the reference work on its SYNTHETIC reconstruction, ",
            "10 pressures of 170 readings, measured geometry; every solver with the same rows. ",
            "Errors are relative to an optimum polished on its active rows by Newton's method. ",
            f"Measured on {html.escape(platform.machine())}, {os.cpu_count()} processors.</p>",
            "<h2>What was asked for, and what was reached</h2>",
            _targets(lines),
            tables,
            _limit(lines, peak),
        ]
    )


def _targets(lines: list[Any]) -> str:
    rows = []
    for task, solver, wanted in TARGETS:
        found = [x for x in lines if x.task == task and x.solver == solver]
        if not found:
            continue
        exact = [x for x in lines if x.task == task and x.solver == EXACT]
        reached = [found[0].ratio, *(found[0].seconds / x.seconds for x in exact)]
        cells = [_reached(ratio, wanted) for ratio in reached]
        cells += ["<td></td>"] * (2 - len(cells))
        rows.append(
            f"<tr><td>{html.escape(task)}</td><td>{wanted:g}</td>{''.join(cells)}"
            f"<td>{html.escape(solver)}</td></tr>"
        )
    head = (
        "<tr><th>task</th><th>times faster, wanted</th><th>reached</th>"
        "<th>with constraints that hold between the stations too</th><th>than</th></tr>"
    )
    return f"<table>{head}{''.join(rows)}</table>"


def _reached(ratio: float, wanted: float) -> str:
    kind = "" if ratio >= wanted else ' class="bad"'
    return f"<td{kind}>{ratio:.0f}</td>"


def _table(lines: list[Any]) -> str:
    head = "".join(
        f"<th>{name}</th>"
        for name in ("solver", "run, ms", "compile, s", "ratio", "largest error", "missed", "note")
    )
    return f"<table><tr>{head}</tr>{''.join(_row(line) for line in lines)}</table>"


def _row(line: Any) -> str:
    missed = f"{line.missed} of {line.problems}"
    cells = (
        html.escape(line.solver),
        f"{line.seconds * 1e3:.4g}",
        _number(line.compile_seconds, "{:.1f}"),
        f"{line.ratio:.3g}",
        _number(line.error, "{:.0e}"),
        f'<span class="bad">{missed}</span>' if line.missed else missed,
        html.escape(line.note),
    )
    kind = ' class="ours"' if line.solver.startswith("this project") else ""
    return f"<tr{kind}>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _number(value: float, form: str) -> str:
    return form.format(value) if math.isfinite(value) else ""


def _limit(lines: list[Any], peak: float) -> str:
    """How far the batch is from the arithmetic of the machine."""
    ours = [x for x in lines if "softens" in x.task and x.solver == "this project"]
    if not ours:
        return ""
    last = ours[-1]
    count = int(last.task.split()[0])
    each = last.seconds / count
    reached = FLOPS / each / 1e9
    return (
        "<h2>The limit</h2><p>One programme of four coefficients takes about "
        f"{FLOPS} floating-point operations when its members walk alone, so that "
        f"{each * 1e6:.2f} microseconds are {reached:.2g} GFlop/s, {reached / peak:.0%} of the "
        f"{peak:.0f} GFlop/s that a large matrix product reaches here. The rest goes to memory "
        "(the state of a walk passes through the cache at every step), to members of a batch that "
        "wait for slower ones, and to choosing rows, which is comparison and not arithmetic.</p>"
    )
