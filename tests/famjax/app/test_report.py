"""The report of a folder: the page as a browser shows it, its figures as files, and the numbers in them."""

import csv
import hashlib
import html
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, check_page

import famjax
from famjax.__main__ import main
from famjax.app.folder import SHEET
from famjax.app.report.source import PRESSURE, states_of
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
SECTIONS = ("What to do next", "Figures", "Errors and cross-checks", "Notes", "Provenance")
WIDTHS = (390, 1280)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A force map, evaluated."""
    made = tmp_path_factory.mktemp("map")
    data = load_bundled("DMSP-10-250")
    write_csv(data, made / "map.csv")
    known = data.specimen
    sheet = ENTRIES.format(rest=known.rest_length * 1e3, wall=known.wall_thickness * 1e3)
    (made / SHEET).write_text(sheet, encoding="utf-8")
    _characterise(made)
    return made


def _characterise(folder: Path, *options: str, units: str = "metric") -> None:
    with pytest.raises(SystemExit) as stop:
        main(["characterise", str(folder), "--units", units, *options])
    assert not stop.value.code


@pytest.mark.slow
@pytest.mark.parametrize("width", WIDTHS)
def test_the_page_stands_on_a_screen(headless: Browser, folder: Path, width: int) -> None:
    check_page(headless, folder / "results" / "report" / "report.html", width, SECTIONS)


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
    _characterise(own, units="us")
    for place in (folder, own):
        page = (place / "results" / "report" / "report.html").read_text()
        assert re.search(
            r'<p class="verdict[^>]*>(Identified|Not identified)[^<]*This report shows the', page
        )
        values = [
            json.loads((place / "results" / name / "figures.json").read_text())["values"]
            for name in ("cylinder", "elastic-cylinder")
        ]
        same = values[1]["braid_compliance"] == 0.0
        assert ("Cylinder and elastic cylinder are the same here" in page) == same
    us = html.unescape((own / "results" / "report" / "report.html").read_text())
    words = re.sub(
        r"<svg.*?</svg>|<style.*?</style>|<table.*?</table>|<[^>]*>", " ", us, flags=re.S
    )
    assert not re.findall(r"\d (?:mm|kPa|Pa|N|J)\b", words)
    assert "(--specimen" not in us


@pytest.mark.slow
def test_figures_are_files_and_their_numbers_tables(folder: Path) -> None:
    report = folder / "results" / "report"
    names = {path.stem for path in (report / "figures").iterdir()}
    page = (report / "report.html").read_text()
    assert names == {"actuation", "strains", "law", "parts", "by-pressure", "work"}
    assert page.count("<figure") == len(names)
    assert page.index("<figure") < page.index("five numbers") < page.index("What to do next")
    for path in (report / "tables").iterdir():
        rows = [*csv.reader(path.read_text().splitlines())]
        assert len(rows) > 1
        assert {len(row) for row in rows} == {len(rows[0])}
        assert f"tables/{path.name}" in page
    with (report / "tables" / "readings.csv").open(newline="") as file:
        found = [*csv.DictReader(file)]
    data = load_bundled("DMSP-10-250")
    measured, model, left = (
        np.array([float(row[f"{name}_N"]) for row in found])
        for name in ("force", "model", "model_less_measured")
    )
    np.testing.assert_allclose(measured, data.force[data.loaded], rtol=1e-7)
    np.testing.assert_allclose(model - measured, left, atol=1e-5)


@pytest.mark.slow
def test_the_inputs_are_named_with_their_digests(folder: Path) -> None:
    report = folder / "results" / "report"
    lines = (report / "inputs.sha256").read_text().splitlines()
    known = {name: value for value, name in (line.split("  ") for line in lines)}
    assert set(known) == {SHEET, "map.csv"}
    page = (report / "report.html").read_text()
    for name, value in known.items():
        assert value == hashlib.sha256((folder / name).read_bytes()).hexdigest()
        assert value in page


def test_states_are_the_muscle_and_its_parts_add_up(chambers: famjax.Muscle) -> None:
    """In inch, psi and lbf; the free contraction is that of the equilibrium."""
    pressures = np.array([40.0, 70.0, 100.0])
    states = states_of(chambers, pressures, 9.28125 * 0.7, 15)
    lengths = 9.28125 * (1 - states.contraction.values)
    np.testing.assert_allclose(states.force, chambers.force(lengths, pressures[:, None]), rtol=1e-9)
    np.testing.assert_allclose(states.terms.sum("term"), states.force, rtol=1e-9)
    assert states.term[0] == PRESSURE
    assert states.term.size == 3
    np.testing.assert_allclose(states.blocked_force, chambers.blocked_force(pressures), rtol=1e-9)
    free = chambers.free_contraction(pressures)
    np.testing.assert_allclose(states.free_contraction, free, rtol=1e-6)
    slope = -9.28125 * chambers.stiffness(9.28125 * (1 - free), pressures)
    np.testing.assert_allclose(states.free_slope, slope, rtol=1e-4)
    np.testing.assert_allclose(states.mean_hoop_strain, states.most_hoop_strain, rtol=1e-9)


def test_a_force_without_a_zero_has_no_free_contraction(chambers: famjax.Muscle) -> None:
    stiff = famjax.Muscle(chambers.geometry, famjax.PolynomialMaterial([1e6]))
    states = states_of(stiff, np.array([1.0, 100.0]), 9.28125 * 0.7, 5)
    assert np.isnan(states.free_contraction).all()  # it pushes at rest
