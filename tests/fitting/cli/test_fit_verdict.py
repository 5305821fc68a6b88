"""`famjax fit` on wrong files, as a person types it: exit code, the reason first, files written."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from fitting import ForceData
from fitting.data import csv_text

QUICK = ("--law", "ogden")
FILES = {"fit.json", "fit.png", "report.html"}


@pytest.fixture
def fit(run: Callable, tmp_path: Path) -> Callable[..., tuple[int, str, str, Path]]:
    """The command on a map in metric units: exit code, output, errors and the folder of the files."""

    def command(data: ForceData | str, *options: object) -> tuple[int, str, str, Path]:
        path, folder = tmp_path / "map.csv", tmp_path / "out"
        path.write_text(data if isinstance(data, str) else csv_text(data, "metric"))
        code, out, err = run("fit", path, *options, "--output", folder)
        return code, " ".join(out.split()), " ".join(err.split()), folder

    return command


def scaled(data: ForceData, factor: float) -> ForceData:
    return dataclasses.replace(data, force=data.force * factor)


@pytest.mark.slow
def test_kgf_labelled_newtons_end_1_with_the_reason_first(fit: Callable, dmsp10: ForceData) -> None:
    code, out, _, folder = fit(scaled(dmsp10, 1 / 9.80665), *QUICK)
    assert code == 1
    assert {path.name for path in folder.iterdir()} == FILES
    assert "Not identified." in out
    assert "The data look wrong. It seems that the forces are in kgf, not N" in out
    saved = json.loads((folder / "fit.json").read_text())
    assert saved["verdict"] == "not identified"
    assert "the forces are in kgf, not N" in saved["suspicions"]


@pytest.mark.slow
def test_a_chosen_model_does_not_hide_a_wrong_file(fit: Callable, dmsp10: ForceData) -> None:
    code, out, _, folder = fit(scaled(dmsp10, 1 / 4.44822))
    assert (code, "lbf, not N" in out) == (1, True)
    assert {path.name for path in folder.iterdir()} == FILES
    assert fit(dmsp10)[0] == 0


def test_a_muscle_of_250_mm_labelled_25(fit: Callable, dmsp10: ForceData) -> None:
    code, _, err, _ = fit(dmsp10, *QUICK, "--specimen", "rest_length_mm=25")
    assert (code, "rest length was in cm, not mm" in err) == (2, True)


@pytest.mark.slow
def test_numbers_of_notes_and_verdict_follow_the_units(fit: Callable, dmsp10: ForceData) -> None:
    lines = csv_text(dmsp10, "metric").splitlines()
    bare = "\n".join(one for one in lines if not one.startswith("#")) + "\n"
    code, told, _, folder = fit(bare, *QUICK, "--units", "us", "--verbose")
    assert code == 0
    page = (folder / "report.html").read_text()
    assert "the longest length in the file, 9.843 in, is taken" in told
    told = told[told.index("note:") :].replace("rest_length_mm=", "").replace("_mm=...", "")
    for text in (told, page[page.index('<p class="verdict') : page.index("<figure")]):
        assert " lbf" in text
        assert not [unit for unit in (" N,", " N.", " mm", " kPa", " MPa") if unit in text]
