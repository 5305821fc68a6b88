"""The report of a folder: the page as a browser shows it, its figures as files, and the numbers in them."""

import html
import json
import re
import shutil
from pathlib import Path

import pytest
from processes import command

from famjax.app.folder import SHEET
from fitting import load_bundled, write_csv

ENTRIES = """
[specimen]
name = "DMSP-10-250"
rest_length_mm = {rest!r}
wall_thickness_mm = {wall!r}
nominal_diameter_mm = 10.0
embedded = true
[records]
force_map = "map.csv"
[fit]
starts = 2
order = 2
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A force map, evaluated."""
    made = tmp_path_factory.mktemp("map")
    data = load_bundled("DMSP-10-250")
    write_csv(data, made / "map.csv")
    known = data.specimen
    sheet = ENTRIES.format(rest=known.rest_length * 1e3, wall=known.wall_thickness * 1e3)
    (made / SHEET).write_text(sheet, encoding="utf-8")
    command("characterise", made, "--units", "metric")
    return made


@pytest.mark.slow
def test_the_page_has_a_verdict_its_units_and_reasons_for_equal_columns(
    folder: Path, tmp_path: Path
) -> None:
    """In metric units, and of a specimen that says less in those of the US."""
    own = tmp_path / "folder"
    own.mkdir()
    shutil.copy(folder / "map.csv", own)
    sheet = (folder / SHEET).read_text().replace("nominal_diameter_mm = 10.0\n", "")
    (own / SHEET).write_text(sheet)
    command("characterise", own, "--units", "us")
    for place in (folder, own):
        page = (place / "results" / "report" / "report.html").read_text()
        assert re.search(
            r'<p class="verdict[^>]*>(Identified|Not identified)[^<]*This report shows the', page
        )
        figures = place / "results" / "elastic-cylinder" / "figures.json"
        same = json.loads(figures.read_text())["values"]["braid_compliance"] == 0.0
        assert ("Cylinder and elastic cylinder are the same here" in page) == same
    us = html.unescape((own / "results" / "report" / "report.html").read_text())
    words = re.sub(
        r"<svg.*?</svg>|<style.*?</style>|<table.*?</table>|<[^>]*>", " ", us, flags=re.S
    )
    assert not re.findall(r"\d (?:mm|kPa|Pa|N|J)\b", words)
    assert "(--specimen" not in us
