"""A characterisation folder from its skeleton to its report, and what is said where it cannot be."""

import json
import re
import shutil
from pathlib import Path

import pytest

from famjax.__main__ import main
from famjax.boundary.errors import InputError
from famjax.chain.folder import SHEET, SKELETON, read_sheet

SPECIMEN = """
[specimen]
name = "a muscle"
rest_length_in = 9.28125
wall_thickness_in = 0.0625
bladder_diameter_in = 0.875
"""
RECORDS = '[records]\nforce_map = "map.csv"\n'


def famjax(capsys: pytest.CaptureFixture, *words: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main([*map(str, words)])
    said = capsys.readouterr()
    return int(stop.value.code or 0), said.out, said.err


def sheet(folder: Path, text: str) -> Path:
    (folder / SHEET).write_text(text, encoding="utf-8")
    return folder


def test_a_new_folder_has_a_sheet_that_can_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    folder = tmp_path / "muscle"
    code, out, _ = famjax(capsys, "new", folder)
    assert code == 0
    assert f"famjax characterise {folder}" in out
    found = read_sheet(folder)
    assert found.specimen.rest_length == 0.25
    assert found.photographs is not None
    assert found.photographs.distance == pytest.approx(1.524)
    code, _, err = famjax(capsys, "new", folder)
    assert code == 2
    assert "is there already" in err
    code, _, err = famjax(capsys, "characterise", folder)
    assert code == 2
    assert "names test.fam, which is not in" in err


def test_every_commented_entry_of_the_skeleton_is_one(tmp_path: Path) -> None:
    """Each by itself, in the place of what it stands for."""
    for line in SKELETON.splitlines():
        entry = line.removeprefix("# ").partition("#")[0].strip()
        if not line.startswith("# ") or "=" not in entry:
            continue
        text = SKELETON.replace(line, entry)
        if entry.startswith("force_map"):
            text = text.replace("journal =", "# ").replace("machine_log =", "# ")
        if entry.startswith("scale"):
            text = text.replace("ruler = ", "# ")
        read_sheet(sheet(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[specimen", "it is not a TOML file"),
        (SPECIMEN, r"has the tables"),
        (RECORDS, r"has the tables"),
        (SPECIMEN + RECORDS + "[fitt]\n", "got specimen, records, fitt"),
        (SPECIMEN + "[records]\n", "journal and machine_log, both of one test, or in a force_map"),
        (SPECIMEN + RECORDS + 'journal = "a"\nmachine_log = "b"\n', "keep one"),
        (SPECIMEN + '[records]\njournal = "a"\n', "both of one test"),
        (
            SPECIMEN.replace("rest_length_in", "rest_length") + RECORDS,
            "unknown entry of the specimen",
        ),
        (SPECIMEN.replace('name = "a muscle"\n', "") + RECORDS, "name, rest_length_<unit> and"),
        (SPECIMEN + "turns = -1\n" + RECORDS, "turns must be a number > 0"),
        (SPECIMEN + RECORDS + "[photographs]\nruler = 'r.jpg'\n", "pictures is missing"),
        (SPECIMEN + RECORDS + "[photographs]\npictures = 'p'\ndistance = 60\n", "has no unit"),
        (
            SPECIMEN + RECORDS + "[fit]\nconstraint = 'druker'\n",
            "none or positive or slope or drucker",
        ),
    ],
)
def test_what_is_wrong_with_a_sheet_is_said(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        read_sheet(sheet(tmp_path, text))


def test_a_folder_without_a_sheet_is_told_how_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"famjax new .* writes one"):
        read_sheet(tmp_path)


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small twin of seed 3, evaluated."""
    folder = tmp_path_factory.mktemp("twin") / "muscle"
    for words in (["twin", str(folder), "--seed", "3"], ["characterise", str(folder)]):
        with pytest.raises(SystemExit) as stop:
            main(words)
        assert not stop.value.code
    return folder


@pytest.mark.slow
def test_a_twin_comes_back(twin: Path) -> None:
    """The law within four of its errors, those of the shape included; the turns within a thousandth."""
    truth = json.loads((twin / "truth.json").read_text())
    found = json.loads((twin / "results" / "measured" / "figures.json").read_text())
    for k, true in enumerate(truth["coefficients"], start=1):
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
    page = (twin / "results" / "report" / "report.html").read_text()
    assert re.search(r'(src|href)="(?!data:|#)', page) is None  # nothing is fetched
    assert page.count("<figure>") == 4
    for words in (
        "Errors of the fits by geometry",
        "identified from the force",
        "1 picture could not be measured",
    ):
        assert words in page


@pytest.mark.slow
def test_the_same_folder_gives_the_same_bytes(
    twin: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    before = {path: path.read_bytes() for path in (twin / "results").rglob("*") if path.is_file()}
    code, _, err = famjax(capsys, "characterise", twin)
    assert code == 0
    assert err.count("as before") == 8
    code, _, err = famjax(capsys, "characterise", twin, "--force", "cylinder", "--only", "cylinder")
    assert code == 0
    after = {path: path.read_bytes() for path in before}
    assert [path for path in before if before[path] != after[path]] == []


@pytest.mark.slow
def test_without_pictures_the_force_alone_is_evaluated(
    twin: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """From the map that the first step made."""
    shutil.copy(twin / "results" / "records" / "dataset.csv", tmp_path / "map.csv")
    code, _, _ = famjax(capsys, "characterise", sheet(tmp_path, SPECIMEN + RECORDS))
    assert code == 0
    page = (tmp_path / "results" / "report" / "report.html").read_text()
    assert "There are no photographs" in page
    assert "There is a force map and no record of the test" in page
