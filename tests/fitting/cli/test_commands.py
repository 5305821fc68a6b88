"""Commands on fits, as a person types them: export, predict, card, assess, and the names of muscles."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import pytest

import famjax
import fitting
from fitting import ForceData
from fitting.data import csv_text

EXAMPLES = Path(__file__).parents[3] / "examples"
STATE = ("--length", "230mm", "--pressure", "5bar")

pytestmark = pytest.mark.slow


def test_the_export_of_a_fit_names_its_file(run: Callable, tmp_path: Path) -> None:
    assert run("fit", "DMSP-10-250", "--order", "2", "--output", tmp_path / "fit")[0] == 0
    assert run("export", tmp_path / "fit" / "fit.json", "--to", "c", "-o", tmp_path / "c")[0] == 0
    (head,) = (tmp_path / "c").glob("*.h")
    assert "of fit.json, sha256 " in head.read_text()


@pytest.mark.parametrize("name", ["DMSP-10", "dmsp_10", "dmsp-10-250", "DMSP-10-250"])
def test_every_name_is_known_everywhere(run: Callable, tmp_path: Path, name: str) -> None:
    assert fitting.load_bundled(name).specimen.name == "DMSP-10-250"
    assert famjax.muscles.bundled_card(name).name == famjax.muscles.bundled_card("DMSP-10").name
    code, out, _ = run("predict", name, *STATE, "--json")
    (row,) = json.loads(out)
    assert (code, row["inside"]) == (0, True)
    expected = float(famjax.muscles.dmsp_10().force(0.23, 5e5))
    assert row["force_N"] == pytest.approx(expected, rel=1e-12)
    code, out, _ = run("export", name, "--to", "csv", "-o", tmp_path)
    assert (code, "dmsp_10" in out) == (0, True)


def test_what_was_not_identified_says_so_wherever_it_is_used(
    run: Callable, dmsp10: ForceData, tmp_path: Path
) -> None:
    text = csv_text(dataclasses.replace(dmsp10, force=dmsp10.force / 9.80665), "metric")
    (tmp_path / "kgf.csv").write_text(text)
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
        assert f"warning: {arguments[1]} holds no identified muscle: The data look wrong." in told
    (table,) = (tmp_path / "out").glob("*.csv")
    assert "WARNING: " in table.read_text()


def test_a_law_of_ones_own_is_assessed_by_other_processes(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.syspath_prepend(EXAMPLES)

    def found(*words: object) -> dict:
        code, out, _ = run(*words, "--json")
        assert code == 0
        return json.loads(out)

    fitted = found("fit", "DMSP-20-300", "--law", "own_law:Gent", "--output", tmp_path)
    asked = ("assess", tmp_path / "fit.json", "--own", "own_law", "--bootstrap", 260)
    one, other = found(*asked), found(*asked, "--jobs", 2)
    drawn = one["bootstrap"]
    assert drawn["replicates"] + drawn["failed"] == 260  # two chunks
    assert drawn == other["bootstrap"]
    assert one["parameters"] == fitted["parameters"]


def test_posterior_of_a_censored_fit(run: Callable, tmp_path: Path) -> None:
    pytest.importorskip("blackjax")
    fitted = run("fit", "DMSP-10-250", "--objective", "censored", "--output", tmp_path, "--json")
    code, out, _ = run("assess", tmp_path / "fit.json", "--posterior", "--json")
    assert {fitted[0], code} <= {0, 1}
    told = json.loads(out)["posterior"]
    assert told["coefficients"] == "sampled"
    assert set(told["parameters"]) >= {"braid_diameter", "E_1", "noise"}
    assert all(one["r_hat"] < 1.02 for one in told["parameters"].values())
    assert "Posterior, 4 chains" in (tmp_path / "report.html").read_text()
