"""Commands on maps and fits, as a person types them: verdicts of wrong files, export, card, assess."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import pytest

import famjax
import fitting
from fitting import ForceData
from fitting.data import csv_text, write_csv

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
def test_kgf_labelled_newtons_end_1_with_the_reason_first(fit, dmsp10):
    code, out, _, folder = fit(scaled(dmsp10, 1 / 9.80665), *QUICK)
    assert code == 1
    assert {path.name for path in folder.iterdir()} == FILES
    assert "Not identified." in out
    assert "The data look wrong. It seems that the forces are in kgf, not N" in out
    saved = json.loads((folder / "fit.json").read_text())
    assert saved["verdict"] == "not identified"
    assert "the forces are in kgf, not N" in saved["suspicions"]


@pytest.mark.slow
def test_a_chosen_model_does_not_hide_a_wrong_file(fit, dmsp10):
    code, out, _, folder = fit(scaled(dmsp10, 1 / 4.44822))
    assert (code, "lbf, not N" in out) == (1, True)
    assert {path.name for path in folder.iterdir()} == FILES
    assert fit(dmsp10)[0] == 0


def test_a_muscle_of_250_mm_labelled_25(fit, dmsp10):
    code, _, err, _ = fit(dmsp10, *QUICK, "--specimen", "rest_length_mm=25")
    assert (code, "rest length was in cm, not mm" in err) == (2, True)


@pytest.mark.slow
def test_numbers_of_notes_and_verdict_follow_the_units(fit, dmsp10):
    lines = csv_text(dmsp10, "metric").splitlines()
    bare = "\n".join(one for one in lines if not one.startswith("#")) + "\n"
    code, told, _, folder = fit(bare, *QUICK, "--units", "us", "--verbose")
    assert code == 0
    page = (folder / "report.html").read_text()
    assert "the longest length in the file, 9.843 in, is used" in told
    told = told[told.index("note:") :].replace("rest_length_mm=", "").replace("_mm=...", "")
    for text in (told, page[page.index('<p class="verdict') : page.index("<figure")]):
        assert " lbf" in text
        assert not [unit for unit in (" N,", " N.", " mm", " kPa", " MPa") if unit in text]


EXAMPLES = Path(__file__).parents[3] / "examples"
STATE = ("--length", "230mm", "--pressure", "5bar")


@pytest.mark.slow
def test_the_export_of_a_fit_names_its_file(said, tmp_path):
    said("fit", "DMSP-10-250", "--order", "2", "--output", tmp_path / "fit")
    said("export", tmp_path / "fit" / "fit.json", "--to", "c", "-o", tmp_path / "c")
    (head,) = (tmp_path / "c").glob("*.h")
    assert "from fit.json, sha256 " in head.read_text()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["DMSP-10", "dmsp_10", "dmsp-10-250", "DMSP-10-250"])
def test_every_name_is_known_everywhere(said, tmp_path, name):
    assert fitting.load_bundled(name).specimen.name == "DMSP-10-250"
    assert famjax.muscles.bundled_card(name).name == famjax.muscles.bundled_card("DMSP-10").name
    (row,) = json.loads(said("predict", name, *STATE, "--json"))
    assert row["inside"]
    expected = float(famjax.muscles.dmsp_10().force(0.23, 5e5))
    assert row["force_N"] == pytest.approx(expected, rel=1e-12)
    assert "dmsp_10" in said("export", name, "--to", "csv", "-o", tmp_path)


@pytest.mark.slow
def test_what_was_not_identified_says_so_wherever_it_is_used(run, dmsp10, tmp_path):
    write_csv(scaled(dmsp10, 1 / 9.80665), tmp_path / "kgf.csv", "metric")
    assert run("fit", tmp_path / "kgf.csv", "--law", "ogden", "--output", tmp_path)[0] == 1
    made, card = tmp_path / "fit.json", tmp_path / "card.json"
    for arguments in (
        ("predict", made, *STATE),
        ("card", made, "--sample", 0),
        ("predict", card, *STATE),
        ("export", made, "--to", "csv", "-o", tmp_path / "out"),
        ("export", card, "--to", "csv", "-o", tmp_path / "out"),
    ):
        code, _, err = run(*arguments)
        told = " ".join(err.split())
        assert code == 0
        assert f"warning: {arguments[1]} contains no identified muscle: The data" in told
    (table,) = (tmp_path / "out").glob("*.csv")
    assert "WARNING: " in table.read_text()


@pytest.mark.slow
def test_a_law_of_ones_own_is_assessed_by_other_processes(said, tmp_path, monkeypatch):
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.syspath_prepend(EXAMPLES)
    fit = "fit", "DMSP-20-300", "--law", "own_law:Gent", "--output", tmp_path
    asked = "assess", tmp_path / "fit.json", "--own", "own_law", "--bootstrap", 260
    every = fit, asked, (*asked, "--jobs", 2)
    fitted, one, other = (json.loads(said(*words, "--json")) for words in every)
    drawn = one["bootstrap"]
    assert drawn["replicates"] + drawn["failed"] == 260  # two chunks
    assert drawn == other["bootstrap"]
    assert one["parameters"] == fitted["parameters"]


@pytest.mark.slow
def test_posterior_of_a_censored_fit(run, tmp_path):
    pytest.importorskip("blackjax")
    fitted = run("fit", "DMSP-10-250", "--objective", "censored", "--output", tmp_path, "--json")
    code, out, _ = run("assess", tmp_path / "fit.json", "--posterior", "--json")
    assert {fitted[0], code} <= {0, 1}
    told = json.loads(out)["posterior"]
    assert set(told["parameters"]) >= {"braid_diameter", "E_1", "noise"}
    assert all(one["r_hat"] < 1.02 for one in told["parameters"].values())
    assert "posterior, 4 chains" in (tmp_path / "report.html").read_text()
