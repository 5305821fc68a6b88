"""The report of a folder: the page as a browser shows it, its figures as files, and the numbers in them."""

import csv
import hashlib
import html
import json
import re
import shutil
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from browser import Browser, check_page

import famjax
from famjax.__main__ import main
from famjax.app.report.bladder_charts import rising_range
from famjax.app.report.chart import AxisQuantity, Chart, PlottedSeries
from famjax.app.report.states import POWERS, PRESSURE, states_of
from famjax.app.report.uncertainty import inflations, ridges
from famjax.app.sheet import SHEET
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
SECTIONS = (
    "Specimen and set-up", "Actuation", "Strains of the bladder", "Stress of the bladder",
    "Parts of the force", "Blocked force, free contraction and errors by pressure",
    "Geometries side by side", "Uncertainty", "Provenance",
)  # fmt: skip
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
            r'<p class="verdict[^>]*>(Identified|Not identified)[^<]*Shown is the', page
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
def test_every_figure_is_a_file_with_its_numbers(folder: Path) -> None:
    report = folder / "results" / "report"
    names = {path.stem for path in (report / "figures").glob("*.svg")}
    page = (report / "report.html").read_text()
    assert {"actuation", "law", "terms-cylinder", "hoop-strain-4", "blocked-force"} <= names
    assert page.count("<figure") == len(names)
    for name in names:
        assert (report / "figures" / f"{name}.pdf").read_bytes().startswith(b"%PDF")
        with (report / "figures" / f"{name}.csv").open(newline="") as file:
            rows = [*csv.reader(file)]
        assert len(rows) > 2
        assert {len(row) for row in rows} == {len(rows[0])}
    with (report / "figures" / "actuation.csv").open(newline="") as file:
        measured = [row for row in csv.DictReader(file) if row["series"].startswith("measured")]
    data = load_bundled("DMSP-10-250")
    np.testing.assert_allclose(
        sorted(float(row["force_N"]) for row in measured),
        np.sort(data.force[data.loaded]),
        rtol=1e-6,
    )


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


@pytest.mark.slow
def test_the_report_has_the_same_bytes_each_time(folder: Path) -> None:
    report = folder / "results" / "report"
    before = {path: path.read_bytes() for path in report.rglob("*") if path.is_file()}
    _characterise(folder, "--force", "report", "--only", "report")
    assert [path for path in before if before[path] != path.read_bytes()] == []


def test_states_are_the_muscle_and_its_parts_add_up(chambers: famjax.Muscle) -> None:
    """In inch, psi and lbf; the free contraction is that of the equilibrium."""
    pressures = np.array([40.0, 70.0, 100.0])
    states = states_of(chambers, pressures, 9.28125 * 0.7, 15)
    lengths = 9.28125 * (1 - states.contraction)
    np.testing.assert_allclose(states.force, chambers.force(lengths, pressures[:, None]), rtol=1e-9)
    np.testing.assert_allclose(sum(states.terms.values()), states.force, rtol=1e-9)
    assert next(iter(states.terms)) == PRESSURE
    assert len(states.terms) == 3
    np.testing.assert_allclose(states.blocked_force, chambers.blocked_force(pressures), rtol=1e-9)
    free = chambers.free_contraction(pressures)
    np.testing.assert_allclose(states.free_contraction(), free, rtol=1e-6)
    # At one radius the mean of a power is the power.
    for n, power in zip(POWERS, states.hoop_powers, strict=True):
        np.testing.assert_allclose(power, states.mean_hoop_strain**n, rtol=1e-9)


def test_a_force_without_a_zero_has_no_free_contraction(chambers: famjax.Muscle) -> None:
    stiff = famjax.Muscle(chambers.geometry, famjax.PolynomialMaterial([1e6]))
    states = states_of(stiff, np.array([1.0, 100.0]), 9.28125 * 0.7, 5)
    assert np.isnan(states.free_contraction()).all()  # it pushes at rest


def test_a_ridge_is_found_where_two_parameters_are_one() -> None:
    rho = 0.99
    matrix = np.array([[1, -rho, 0], [-rho, 1, 0], [0, 0, 1.0]])
    np.testing.assert_allclose(inflations(matrix), [1 / np.sqrt(1 - rho**2)] * 2 + [1.0])
    (ridge,) = ridges(("D0", "angle", "E_1"), matrix, np.array([2.0, 0.5, 10.0]))
    assert ridge.names == ("D0", "angle")
    root = np.sqrt((1 + rho) / 2)
    np.testing.assert_allclose(ridge.steps, (2.0 * root, -0.5 * root))
    assert ridges(("a", "b"), np.eye(2), np.ones(2)) == []


@pytest.mark.parametrize(
    ("law", "ends"),
    [
        ([3.0, 0.0, -4.0], (-0.25, 0.5)),  # 3 - 12 e^2 = 0 at 0.5; the axial side ends before it
        ([1.0], (-0.25, 1.25)),
        ([-1.0, 2.0], None),
    ],
)
def test_the_stable_range_ends_where_the_stress_falls(
    law: list[float], ends: tuple[float, float] | None
) -> None:
    found = rising_range(famjax.PolynomialMaterial(jnp.array(law)), -0.25, 1.25)
    assert found == (None if ends is None else pytest.approx(ends, abs=4e-3))


def test_a_chart_writes_the_numbers_it_shows() -> None:
    x, y = np.array([0.0, 0.1]), np.array([3.0, np.nan])
    chart = Chart(
        "force", "A force.", AxisQuantity("contraction", "contraction"), AxisQuantity("force", "$F$", "N"),
        [PlottedSeries("model", x, y, y - 1, y + 1),
         PlottedSeries("measured, one", x, x, marker="o", dash="")],
    )  # fmt: skip
    assert chart.table() == (
        "series,contraction,force_N,low_95_force_N,high_95_force_N\n"
        "model,0,3,2,4\nmodel,0.1,,,\n"
        '"measured, one",0,0,,\n"measured, one",0.1,0.1,,\n'
    )
    drawn = chart.drawing()
    assert drawn.svg == chart.drawing().svg
    assert drawn.pdf == chart.drawing().pdf
    assert not re.search(rb"CreationDate", drawn.pdf)
