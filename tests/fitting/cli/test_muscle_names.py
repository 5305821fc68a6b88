"""A muscle by any of its names, and one that was not identified, in every command that takes it."""

import dataclasses
import json
from pathlib import Path

import pytest

import famjax
import fitting
from famjax.__main__ import main
from fitting.data import csv_text


def run(capsys: pytest.CaptureFixture, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main([*map(str, arguments)])
    captured = capsys.readouterr()
    return int(stop.value.code or 0), captured.out, captured.err


@pytest.mark.slow
@pytest.mark.parametrize("name", ["DMSP-10", "dmsp_10", "dmsp-10-250", "DMSP-10-250"])
def test_every_name_is_known_everywhere(
    capsys: pytest.CaptureFixture, tmp_path: Path, name: str
) -> None:
    assert fitting.load_bundled(name).specimen.name == "DMSP-10-250"
    assert famjax.muscles.bundled_card(name).name == famjax.muscles.bundled_card("DMSP-10").name
    code, out, _ = run(capsys, "predict", name, "--length", "230mm", "--pressure", "5bar", "--json")
    (row,) = json.loads(out)
    assert code == 0
    assert row["force_N"] == pytest.approx(
        float(famjax.muscles.dmsp_10().force(0.23, 5e5)), rel=1e-12
    )
    assert row["inside"]
    code, out, _ = run(capsys, "export", name, "--to", "csv", "-o", tmp_path)
    assert (code, "dmsp_10" in out) == (0, True)


@pytest.mark.slow
def test_what_was_not_identified_says_so_wherever_it_is_used(
    capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    sound = fitting.load_bundled("DMSP-10-250")
    text = csv_text(dataclasses.replace(sound, force=sound.force / 9.80665), "metric")
    (tmp_path / "kgf.csv").write_text(text)
    code, _, _ = run(capsys, "fit", tmp_path / "kgf.csv", "--law", "ogden", "--output", tmp_path)
    assert code == 1
    made, card = tmp_path / "fit.json", tmp_path / "card.json"
    asked = ("--length", "230mm", "--pressure", "5bar")
    for arguments in (
        ("predict", made, *asked),
        ("card", made, "--sample", 0),
        ("predict", card, *asked),
        ("export", made, "--to", "csv", "-o", tmp_path / "out"),
        ("export", card, "--to", "csv", "-o", tmp_path / "out"),
    ):
        code, _, err = run(capsys, *arguments)
        told = " ".join(err.split())
        assert code == 0
        assert f"warning: {arguments[1]} holds no identified muscle: The data look wrong." in told
    (table,) = (tmp_path / "out").glob("*.csv")
    assert "WARNING: " in table.read_text()
