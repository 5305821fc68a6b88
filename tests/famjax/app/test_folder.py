"""A characterisation folder from its skeleton to its report, and what is said where it cannot be."""

import json
import re
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from processes import command
from rendering.folder import TRUE_LENGTHS, write_twin
from rendering.folder_truth import TRUTH

from famjax.app.folder import SHEET, read_sheet
from famjax.boundary.errors import InputError

SPECIMEN = """
[specimen]
name = "a muscle"
rest_length_in = 9.28125
wall_thickness_in = 0.0625
bladder_diameter_in = 0.875
"""
RECORDS = '[records]\nforce_map = "map.csv"\n'


def sheet(folder: Path, text: str) -> Path:
    (folder / SHEET).write_text(text, encoding="utf-8")
    return folder


def test_a_new_folder_has_a_sheet_that_can_be_read(tmp_path: Path, run: Callable) -> None:
    folder = tmp_path / "muscle"
    code, out, _ = run("new", folder)
    assert code == 0
    assert f"famjax characterise {folder}" in out
    found = read_sheet(folder)
    assert found.specimen.rest_length == 0.25
    assert found.photographs is not None
    assert found.photographs.distance == pytest.approx(1.524)
    code, _, err = run("new", folder)
    assert code == 2
    assert "is there already" in err
    code, _, err = run("characterise", folder)
    assert code == 2
    assert "names test.fam, which is not in" in err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[specimen", "it is not a TOML file"),
        (SPECIMEN, "must have the tables"),
        (RECORDS, "must have the tables"),
        (SPECIMEN + RECORDS + "[fitt]\n", "got specimen, records, fitt"),
        (SPECIMEN + "[records]\n", "journal and machine_log, both of one test, or in a force_map"),
        (SPECIMEN + RECORDS + 'journal = "a"\nmachine_log = "b"\n', "keep one"),
        (SPECIMEN + '[records]\njournal = "a"\n', "both of one test"),
        (SPECIMEN.replace('name = "a muscle"\n', "") + RECORDS, "name, rest_length_<unit> and"),
        (SPECIMEN + RECORDS + "[photographs]\nruler = 'r.jpg'\n", "pictures is missing"),
        (SPECIMEN + RECORDS + "[fit]\nconstraint = 'druker'\n", "none or positive or slope or drucker"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_sheet_is_said(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        read_sheet(sheet(tmp_path, text))


TRUE = (TRUTH, TRUE_LENGTHS)


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small twin of seed 3, evaluated while its truth was elsewhere: no step reads it."""
    place = tmp_path_factory.mktemp("twin")
    folder = place / "muscle"
    write_twin(folder, seed=3)
    for name in TRUE:
        (folder / name).rename(place / name)
    command("characterise", folder)
    for name in TRUE:
        (place / name).rename(folder / name)
    return folder


@pytest.mark.slow
def test_a_twin_comes_back(twin: Path) -> None:
    """The law within four of its errors, those of the shape included; the turns within a thousandth."""
    truth = tomllib.loads((twin / TRUTH).read_text())["muscle"]
    found = json.loads((twin / "results" / "measured" / "figures.json").read_text())
    for k, true in enumerate(truth["coefficients_Pa"], start=1):
        name = f"E_{k}"
        assert abs(found["values"][name] - true) < 4 * found["std"][name]
    assert found["values"]["turns"] == pytest.approx(truth["turns"], rel=2e-3)
    others = {
        name: json.loads((twin / "results" / name / "figures.json").read_text())["rmse_N"]
        for name in ("cylinder", "average-diameter", "virtual-work")
    }
    assert found["rmse_N"] < min(others.values())
    assert found["rmse_N"] < 1e-3 * found["largest_force_N"]


@pytest.mark.slow
def test_the_report_is_whole(twin: Path) -> None:
    report = twin / "results" / "report"
    page = (report / "report.html").read_text()
    assert re.search(r'(src|href)="(?!data:|#)', page) is None  # nothing is fetched
    names = {path.stem for path in (report / "figures").iterdir()}
    assert page.count("<figure") == len(names) == 9
    assert {"photographs", "shape", "test"} < names
    for words in (
        "identified from the force",
        "1 picture could not be measured",
        "length in the pictures over displacement of the machine",
        "complete strokes in journal and log: expected 6 or more, found 5",
    ):
        assert words in page


PICTURES = """
[photographs]
pictures = "photographs"
scale = "76.97+-0.02 px/in"
distance_in = 60
[fit]
order = 3
starts = 2
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "notes"),
    [
        (
            SPECIMEN + RECORDS,
            ("There are no photographs", "There is a force map and no record of the test"),
        ),
        (
            SPECIMEN.replace("bladder_diameter_in = 0.875", "braid_thickness_in = 0.011")
            + RECORDS
            + PICTURES,
            (
                "The photographs have no log beside them",
                "There is no photograph of a ruler",
                "diameter at rest is not stated",
            ),
        ),
    ],
    ids=["no pictures", "pictures alone"],
)
def test_what_a_folder_does_not_hold_is_noted(
    twin: Path, tmp_path: Path, run: Callable, text: str, notes: tuple[str, ...]
) -> None:
    """From the map that the first step made; the scale stated, the bladder not measured."""
    shutil.copy(twin / "results" / "records" / "dataset.csv", tmp_path / "map.csv")
    if "photographs" in text:
        shutil.copytree(twin / "photographs", tmp_path / "photographs")
    code, _, err = run("characterise", sheet(tmp_path, text))
    assert code == 0
    page = (tmp_path / "results" / "report" / "report.html").read_text()
    for words in notes:
        assert words in page
        assert words in err
