"""A characterisation folder from its skeleton to its report: steps done once, checks, what is said."""

import html
import json
import math
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from processes import command
from rendering.folder import TRUE_LENGTHS, write_twin
from rendering.folder_truth import TRUTH

from famjax.app.checks import Check, read_checks, settle
from famjax.app.evaluation import pressure_at
from famjax.app.folder import SHEET, Steps, read_sheet
from famjax.boundary.errors import InputError
from fitting import load_bundled, write_csv

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


def test_a_new_folder_has_a_sheet_that_can_be_read(tmp_path, said, refused):
    folder = tmp_path / "muscle"
    assert f"famjax characterise {folder}" in said("new", folder)
    found = read_sheet(folder)
    assert found.specimen.rest_length == 0.25
    assert found.photographs is not None
    assert found.photographs.distance == pytest.approx(1.524)
    refused("already exists", "new", folder)
    refused("refers to test.fam, which is not in", "characterise", folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[specimen", "it must be a TOML file"),
        (SPECIMEN, "must have the tables"),
        (RECORDS, "must have the tables"),
        (SPECIMEN + RECORDS + "[fitt]\n", "got specimen, records, fitt"),
        (SPECIMEN + "[records]\n", "journal and machine_log, from the same test, or set only force_map"),
        (SPECIMEN + RECORDS + 'journal = "a"\nmachine_log = "b"\n', "or set only force_map"),
        (SPECIMEN + '[records]\njournal = "a"\n', "journal and machine_log, from the same test"),
        (SPECIMEN.replace('name = "a muscle"\n', "") + RECORDS, "name, rest_length_<unit> and"),
        (SPECIMEN + RECORDS + "[photographs]\nruler = 'r.jpg'\n", "pictures is missing"),
        (SPECIMEN + RECORDS + "[fit]\nconstraint = 'druker'\n", "none or positive or slope or drucker"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_sheet_is_said(text, message, tmp_path):
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
@pytest.mark.long
def test_a_twin_comes_back_and_its_report_is_whole(twin):
    """The law within four of its errors, those of the shape included; the turns within a thousandth."""
    truth = tomllib.loads((twin / TRUTH).read_text())["muscle"]
    found = json.loads((twin / "results" / "measured" / "figures.json").read_text())
    for k, true in enumerate(truth["coefficients_Pa"], start=1):
        name = f"E_{k}"
        assert abs(found["values"][name] - true) < 4 * found["std"][name]
    assert found["values"]["turns"] == pytest.approx(truth["turns"], rel=2e-3)
    for name in ("cylinder", "average-diameter", "virtual-work"):
        other = json.loads((twin / "results" / name / "figures.json").read_text())
        assert found["rmse_N"] < other["rmse_N"]
    assert found["rmse_N"] < 1e-3 * found["largest_force_N"]
    report = twin / "results" / "report"
    page = (report / "report.html").read_text()
    assert re.search(r'(src|href)="(?!data:|#)', page) is None  # nothing is fetched
    names = {path.stem for path in (report / "figures").iterdir()}
    assert page.count("<figure") == len(names) == 8
    assert {"photographs", "shape", "test"} < names
    for words in (
        "identified from the force",
        "1 picture could not be measured",
        "ratio of photographed length to machine displacement",
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
@pytest.mark.long
@pytest.mark.parametrize(
    ("text", "notes"),
    [
        (SPECIMEN + RECORDS,
         ("There are no photographs", "There is a force map but no journal from the test")),
        (SPECIMEN.replace("bladder_diameter_in = 0.875", "braid_thickness_in = 0.011") + RECORDS + PICTURES,
         ("There is no machine log for the photographs", "There is no photograph of a ruler",
          "diameter at rest is not stated")),
    ],
    ids=["no pictures", "pictures alone"],
)  # fmt: skip
def test_what_a_folder_does_not_hold_is_noted(twin, tmp_path, run, text, notes):
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


def test_what_is_done_is_not_done_again_and_a_change_redoes_what_follows(tmp_path):
    source, ran, told = tmp_path / "source.txt", [], []
    source.write_text("1")
    results = tmp_path / "results"

    def run(factor: int = 2, *, fails: bool = False) -> list[str]:
        ran.clear()
        told.clear()

        def double(place: Path) -> None:
            ran.append("double")
            (place / "number.txt").write_text(str(int(source.read_text()) * factor))

        def say(place: Path) -> None:
            ran.append("say")
            (place / "begun.txt").touch()
            if fails:
                raise KeyboardInterrupt
            number = (results / "double" / "number.txt").read_text()
            (place / "said.txt").write_text(f"it is {number}")

        steps = Steps(results, told.append)
        steps.run("double", double, files=[source], options={"factor": factor})
        steps.run("say", say)
        return [*ran]

    with pytest.raises(KeyboardInterrupt):
        run(fails=True)
    (results / "say" / "part.txt").touch()
    assert run() == ["say"]
    assert (results / "say" / "part.txt").exists()  # from where it was interrupted
    assert run() == []
    assert told == ["double: unchanged", "say: unchanged"]
    source.write_text("3")
    assert run() == ["double", "say"]
    assert not (results / "say" / "part.txt").exists()
    assert run(5) == ["double", "say"]
    said = results / "say" / "said.txt"
    assert said.read_text() == "it is 15"
    said.write_text("edited")
    assert run(5) == ["say"]
    assert said.read_text() == "it is 15"


LOG = "machine.csv"
FEW_PICTURES = """
[rig]
pressures_psi = [40, 70]
stroke_in = 1.5
rate_in_per_s = 0.2
settle_s = 3
[camera]
pictures = 8
damaged = 0
[errors]
rest_length_m = 0.0
wall_thickness_m = 0.0
bladder_diameter_m = 0.0
braid_thickness_m = 0.0
"""


def test_a_picture_in_a_gap_of_the_journal_has_no_pressure(tmp_path):
    path = tmp_path / "pressures.csv"
    path.write_text("time_s,pressure_Pa\n0,100\n1,110\n2,120\n9,190\n10,200\n")
    found = pressure_at(path, np.array([0.5, 1.0, 5.5, 9.5, 20.0, np.nan]))
    np.testing.assert_allclose(found, [105, 110, np.nan, 195, np.nan, np.nan])


def test_a_contradiction_stops_and_all_checks_are_written(tmp_path):
    fine = Check.about("this", 1.0, 1.0, 0.01)
    wrong = Check.about("that", 2.0, 1.0, 0.01, unit="mm")
    with pytest.raises(InputError, match=r"that: expected 0.98 to 1.02 mm, found 2 mm"):
        settle([fine, wrong], tmp_path)
    assert read_checks(tmp_path) == [fine, wrong]
    settle([fine, Check.of("what", -1.0, (0.0, math.inf), say="Say so.")], tmp_path)
    assert read_checks(tmp_path)[1].sentence() == "what: expected 0 or more, found -1. Say so."
    assert read_checks(tmp_path / "none") == []


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("sound")
    (place / TRUTH).write_text(FEW_PICTURES)
    write_twin(place / "muscle", flawed=False, truth=place / TRUTH)
    return place / "muscle"


@pytest.fixture
def copied(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "muscle"))


def replaced(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        (LOG, "(mm),(N)", "(in),(N)", "check the unit and sign of the displacement"),
        (LOG, "(mm),(N)", "(mm),(lbf)", "factor of 4.448 means that lbf and N were confused"),
        (LOG, "(mm),(N)", "(mm),(kN)", "by a factor of 0.001"),
        (LOG, "(s),(mm)", "(s),(um)", "1000, m and mm or mm and um"),
        (LOG, "Extension,Load", "Load,Extension", "column 'Extension' has the unknown unit 'N'"),
        (SHEET, "[records]", "[records]\npushing_positive = true", "its sign (pushing_positive is true)"),
        (SHEET, "[records]", "[records]\nshortening_positive = true", "Set shortening_positive to false"),
        (SHEET, "thickness_in = 0.0625", "thickness_in = 1.5875", "must be thinner than half"),
        (SHEET, "rest_length_in", "rest_length_mm", "with a rest length of 0.0092812 m"),
    ],
)  # fmt: skip
def test_records_that_contradict_stop_the_work(copied, refused, name, old, new, words):
    replaced(copied / name, old, new)
    assert "pictures ..." not in refused(words, "characterise", copied)


@pytest.mark.slow
@pytest.mark.long
def test_pictures_that_contradict_stop_the_work_and_a_mended_sheet_goes_on(copied, run, refused):
    sheet, words = copied / SHEET, ("characterise", copied, "--jobs", 1)
    replaced(sheet, "rest_length_in = 9.28125", "rest_length_in = 9.78125")
    told = refused("rest length: expected", *words)
    assert re.search(r"rest length: expected 24[78]\.\d to 24[89]\.\d mm, found 235\.\d mm", told)
    replaced(sheet, "rest_length_in = 9.78125", "rest_length_in = 9.28125")
    replaced(sheet, "pitch_in = 0.125", "pitch_cm = 0.125")
    refused("Check the pitch of the ruler", *words)
    replaced(sheet, "pitch_cm = 0.125", "pitch_in = 0.125")
    code, _, err = run(*words)
    assert code == 0
    assert "warning" not in err
    assert {check.verdict for check in read_checks(copied / "results" / "pictures")} == {"agrees"}


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


@pytest.mark.slow
def test_the_page_has_a_verdict_and_its_units(tmp_path):
    """In metric units, and of a specimen that says less in those of the US."""
    data, places = load_bundled("DMSP-10-250"), (tmp_path / "metric", tmp_path / "us")
    known = data.specimen
    sheet = ENTRIES.format(rest=known.rest_length * 1e3, wall=known.wall_thickness * 1e3)
    for place, left_out in zip(places, ("none", "nominal_diameter_mm = 10.0\n"), strict=True):
        place.mkdir()
        write_csv(data, place / "map.csv")
        (place / SHEET).write_text(sheet.replace(left_out, ""))
        command("characterise", place, "--units", place.name)
        page = (place / "results" / "report" / "report.html").read_text()
        verdict = r'<p class="verdict[^>]*>(?:Not i|I)dentified[^<]*This report shows the'
        assert re.search(verdict, page)
    us, markup = html.unescape(page), r"<(svg|style|table).*?</\1>|<[^>]*>"
    words = re.sub(markup, " ", us, flags=re.S)
    assert not re.findall(r"\d (?:mm|kPa|Pa|N|J)\b", words)
    assert "(--specimen" not in us
