"""`famjax fit` on wrong files, as a person types it: exit code, the reason first, files written."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from famjax.__main__ import main
from fitting import ForceData, load_bundled
from fitting.data import csv_text

QUICK = ("--law", "ogden")

Fit = Callable[..., tuple[int, str, str, Path]]


@pytest.fixture(scope="module")
def sound() -> ForceData:
    """The map of a real muscle."""
    return load_bundled("DMSP-10-250")


@pytest.fixture
def fit(capsys: pytest.CaptureFixture, tmp_path: Path) -> Fit:
    """The command on a file of this text: exit code, output, errors and the folder of the files."""

    def run(text: str, *options: object) -> tuple[int, str, str, Path]:
        path, folder = tmp_path / "map.csv", tmp_path / "out"
        path.write_text(text)
        with pytest.raises(SystemExit) as stop:
            main([str(one) for one in ("fit", path, *options, "--output", folder)])
        captured = capsys.readouterr()
        return int(stop.value.code or 0), captured.out, captured.err, folder

    return run


def metric(data: ForceData, **columns: np.ndarray) -> str:
    """The file of a map in N, kPa and mm, with other numbers in some columns."""
    return csv_text(dataclasses.replace(data, **columns), "metric")


def written(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


FILES = {"fit.json", "fit.png", "report.html"}


@pytest.mark.slow
def test_kgf_labelled_newtons_end_1_with_the_reason_first(fit: Fit, sound: ForceData) -> None:
    code, out, _, folder = fit(metric(sound, force=sound.force / 9.80665), *QUICK)
    assert code == 1
    assert written(folder) == FILES
    told = " ".join(out.split())
    assert "Not identified." in told
    assert "The data look wrong. It seems that the forces are in kgf, not N" in told
    saved = json.loads((folder / "fit.json").read_text())
    assert saved["verdict"] == "not identified"
    assert "the forces are in kgf, not N" in saved["suspicions"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("does not rise", lambda data: {"force": 300 + 1e-3 * np.arange(data.force.size)}),
        ("outlier", lambda data: {"force": np.where(np.arange(85) == 84, 99999.0, data.force)}),
        ("absolute", lambda data: {"pressure": data.pressure + 101.3e3}),
    ],
)
def test_what_was_identified_whatever_the_misfit(
    fit: Fit, sound: ForceData, what: str, change: Callable[[ForceData], dict[str, np.ndarray]]
) -> None:
    changes = change(sound)
    if what == "outlier":
        changes["force"] = sound.force.copy()
        changes["force"][np.flatnonzero(sound.loaded)[7]] = 99999.0
    code, out, _, folder = fit(metric(sound, **changes), *QUICK)
    assert code == 1
    assert what in " ".join(out.split())
    assert written(folder) == FILES


def test_pascals_labelled_kilopascals_are_refused(fit: Fit, sound: ForceData) -> None:
    text = metric(sound).splitlines()
    head = next(k for k, line in enumerate(text) if not line.startswith("#"))
    place = text[head].split(",").index("pressure_kPa")
    rows = [line.split(",") for line in text[head + 1 :]]
    for row in rows:
        row[place] = str(float(row[place]) * 1e3)
    code, _, err, _ = fit("\n".join([*text[: head + 1], *map(",".join, rows)]) + "\n", *QUICK)
    assert code == 2
    assert "a pressure of a muscle lies between" in " ".join(err.split())


def test_a_muscle_of_250_mm_labelled_25(fit: Fit, sound: ForceData) -> None:
    code, _, err, _ = fit(metric(sound), *QUICK, "--specimen", "rest_length_mm=25")
    assert code == 2
    assert "rest length was in cm, not mm" in " ".join(err.split())


@pytest.mark.slow
def test_numbers_of_notes_and_verdict_follow_the_units(fit: Fit, sound: ForceData) -> None:
    bare = "\n".join(one for one in metric(sound).splitlines() if not one.startswith("#")) + "\n"
    code, out, _, folder = fit(bare, *QUICK, "--units", "us", "--verbose")
    assert code == 0
    told = " ".join(out.split())
    page = (folder / "report.html").read_text()
    assert "the longest length in the file, 9.843 in, is taken" in told
    told = told[told.index("note:") :].replace("rest_length_mm=", "").replace("_mm=...", "")
    for text in (told, page[page.index('<p class="verdict') : page.index("<figure")]):
        assert " lbf" in text
        assert not [unit for unit in (" N,", " N.", " mm", " kPa", " MPa") if unit in text]


def test_contractions_in_percent_are_read_and_ten_times_a_percent_is_not(
    fit: Fit, sound: ForceData
) -> None:
    rest = sound.specimen.rest_length
    text = metric(sound).replace("length_mm\n", "contraction_%\n")
    head, _, rows = text.partition("contraction_%\n")
    cells = [row.split(",") for row in rows.splitlines()]
    percent = [f"{f},{P},{100 * (1 - float(L) / 1e3 / rest)!r}" for f, P, L in cells]
    code, out, _, _ = fit(head + "contraction_%\n" + "\n".join(percent) + "\n", *QUICK)
    assert code == 0
    assert "dentified" in out
    code, _, err, _ = fit(head + "contraction\n" + "\n".join(percent) + "\n", *QUICK)
    assert (code, "write percent in a column contraction_%" in " ".join(err.split())) == (2, True)
    code, _, err, _ = fit(head + "length_mm\n" + "\n".join(percent) + "\n", *QUICK)
    assert (code, "contraction_%, in percent" in " ".join(err.split())) == (2, True)


@pytest.mark.slow
def test_a_chosen_model_does_not_hide_a_wrong_file(fit: Fit, sound: ForceData) -> None:
    code, out, _, folder = fit(metric(sound, force=sound.force / 4.44822))
    assert (code, "lbf, not N" in out) == (1, True)
    assert written(folder) == FILES
    assert fit(metric(sound))[0] == 0
