"""What two sources say of one thing: verdicts, their files, and damaged folders that stop or warn."""

import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from rendering.folder import write_twin

from famjax.app.checks import Check, checks_table, read_checks, settle
from famjax.boundary.errors import InputError

LOG, SHEET = "machine.csv", "characterisation.toml"
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


def test_a_contradiction_stops_and_all_checks_are_written(tmp_path: Path) -> None:
    fine, wrong = (
        Check.about("this", 1.0, 1.0, 0.01),
        Check.about("that", 2.0, 1.0, 0.01, unit="mm"),
    )
    with pytest.raises(InputError, match=r"that: expected 0.98 to 1.02 mm, found 2 mm"):
        settle([fine, wrong], tmp_path)
    assert read_checks(tmp_path) == [fine, wrong]
    open_ = Check.of("what", math.nan, (0.0, math.inf), say="Say so.")
    settle([fine, open_], tmp_path)
    assert read_checks(tmp_path)[1].sentence() == "what: not known. Say so."
    (table,) = checks_table([tmp_path])
    assert table.rows == [
        ("this", "0.98 to 1.02", "1", "agrees"),
        ("what", "0 or more", "not known", "not known"),
    ]
    assert checks_table([tmp_path / "none"]) == []


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short twin of eight pictures, not evaluated."""
    place = tmp_path_factory.mktemp("sound")
    (place / "truth.toml").write_text(FEW_PICTURES)
    write_twin(place / "muscle", flawed=False, truth=place / "truth.toml")
    return place / "muscle"


@pytest.fixture
def folder(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "muscle"))


def replaced(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        (LOG, "(mm),(N)", "(in),(N)", "check the unit of the displacement"),
        (LOG, "(mm),(N)", "(mm),(lbf)", "ratio of lbf and N"),
        (LOG, "(mm),(N)", "(mm),(kN)", "by a factor of 0.001"),
        (LOG, "(s),(mm)", "(s),(um)", "ratio of m and mm"),
        (LOG, "Extension,Load", "Load,Extension", "column 'Extension' has the unknown unit 'N'"),
        (SHEET, "[records]", "[records]\npushing_positive = true", "pushing_positive must be false"),
        (SHEET, "[records]", "[records]\nshortening_positive = true", "shortening_positive must be f"),
        (SHEET, "thickness_in = 0.0625", "thickness_in = 1.5875", "does not fit twice"),
        (SHEET, "rest_length_in", "rest_length_mm", "with a rest length of 0.0092812 m"),
    ],
)  # fmt: skip
def test_records_that_contradict_stop_the_work(
    folder: Path, run: Callable, name: str, old: str, new: str, said: str
) -> None:
    replaced(folder / name, old, new)
    code, _, err = run("characterise", folder)
    assert code == 2
    assert said in err.replace("\n", " ")
    assert "pictures ..." not in err


@pytest.mark.slow
def test_pictures_that_contradict_stop_the_work_and_a_mended_sheet_goes_on(
    folder: Path, run: Callable
) -> None:
    steps = ("--only", "records", "--only", "pictures", "--jobs", "1")
    sheet = folder / SHEET
    replaced(sheet, "rest_length_in = 9.28125", "rest_length_in = 9.78125")
    code, _, err = run("characterise", folder, *steps)
    assert code == 2
    assert re.search(r"rest length: expected 24[78]\.\d to 24[89]\.\d mm, found 235\.\d mm", err)
    replaced(sheet, "rest_length_in = 9.78125", "rest_length_in = 9.28125")
    replaced(sheet, "pitch_in = 0.125", "pitch_cm = 0.125")
    code, _, err = run("characterise", folder, *steps)
    assert code == 2
    assert "is the pitch of the ruler right" in err
    replaced(sheet, "pitch_cm = 0.125", "pitch_in = 0.125")
    code, _, err = run("characterise", folder, *steps)
    assert code == 0
    assert "warning" not in err
    assert {check.verdict for check in read_checks(folder / "results" / "pictures")} == {"agrees"}
