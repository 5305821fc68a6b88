"""The step that writes the report: page, figures as files with their numbers, digests."""

import itertools
import json
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from famjax.boundary.files import write_all
from famjax.boundary.origin import Origin
from famjax.boundary.sentence import text_in_units
from fitting.saved import inline_svg, page

from ..checks import doubts
from ..evaluation import REPORT, shown_pictures
from ..sheet import SHEET, Sheet
from ..steps import FolderStep
from .chart import Drawing
from .provenance import input_digests, input_lines, input_table, origin_table
from .sections import Section, notes, sections, summary, unknown, verdict
from .source import read_source

FIRST_RUN = "first-run.json"
PAGE, FIGURES, INPUTS, UNKNOWN = "report.html", "figures", "inputs.sha256", "unknown.json"
"""Names in the step's folder."""


def first_run(results: Path, now: Origin) -> Origin:
    """When the folder was first evaluated, and by which command: the date of all its files."""
    path = results / FIRST_RUN
    if not path.exists():
        write_all(results, {FIRST_RUN: (json.dumps(now.as_dict()) + "\n").encode()})
    return Origin(**json.loads(path.read_text(encoding="utf-8")))


def report_step(
    sheet: Sheet, steps: Sequence[FolderStep], *, origin: Origin, system: str
) -> FolderStep:
    """The step that writes the report of the steps before it."""
    names = [step.name for step in steps]

    def run(place: Path) -> None:
        _write(sheet, names, origin, system, place)

    return FolderStep(
        REPORT, [sheet.folder / SHEET], {"system": system}, names, run,
        says=lambda place: json.loads((place / UNKNOWN).read_text(encoding="utf-8")),
    )  # fmt: skip


def _write(sheet: Sheet, names: Sequence[str], origin: Origin, system: str, place: Path) -> None:
    source = read_source(sheet, names, system)
    digests = input_digests(sheet)
    taken = 0 if sheet.photographs is None else len(shown_pictures(sheet, sheet.photographs))
    parts, lacking = sections(source), unknown(source)
    provenance = Section("Provenance", tables=[origin_table(origin), input_table(digests, taken)])
    figures, tables = itertools.count(1), itertools.count(1)
    text = page(
        "characterisation.html", "famjax.app",
        name=sheet.specimen.name,
        verdict=text_in_units(verdict(source), system),
        good=source.best.saved.document.get("verdict") != "not identified",
        summary=summary(source),
        unknown=[text_in_units(one, system) for one in (*lacking, *doubts(source.steps))],
        sections=[_shown(part, figures, tables) for part in (*parts, provenance)],
        notes=[text_in_units(one, system) for one in notes(source)],
    )  # fmt: skip
    (place / PAGE).write_text(text, encoding="utf-8")
    (place / INPUTS).write_text(input_lines(digests), encoding="utf-8")
    (place / UNKNOWN).write_text(json.dumps(lacking, indent=1) + "\n", encoding="utf-8")
    folder = place / FIGURES
    folder.mkdir()
    for drawing in (drawing for part in parts for drawing in part.figures):
        (folder / f"{drawing.name}.svg").write_text(drawing.svg, encoding="utf-8")
        (folder / f"{drawing.name}.pdf").write_bytes(drawing.pdf)
        (folder / f"{drawing.name}.csv").write_text(drawing.table, encoding="utf-8")


def _shown(part: Section, figures: itertools.count, tables: itertools.count) -> dict[str, object]:
    """A section as the template takes it, figures and tables numbered over the page."""
    drawn = [(one, _figure(one, next(figures))) for one in part.figures]
    numbered = [one.html(next(tables)) for one in part.tables]
    return {
        "title": part.title,
        "anchor": part.title.lower().replace(",", "").replace(" ", "-"),
        "text": part.text,
        "small": bool(part.figures) and all(one.size == "small" for one in part.figures),
        "figures": [shown for one, shown in drawn if one.size != "wide"],
        "wide": [shown for one, shown in drawn if one.size == "wide"],
        "beside": numbered[: part.beside],
        "tables": numbered[part.beside :],
    }


def _figure(drawing: Drawing, number: int) -> tuple[Markup, int, str]:
    return inline_svg(drawing.svg, drawing.name, drawing.caption), number, drawing.caption
