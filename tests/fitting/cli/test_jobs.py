"""`famjax assess --jobs`: other processes, the same numbers, with a law of one's own."""

import json
import re
from pathlib import Path

import pytest

from famjax.__main__ import main

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.mark.slow
def test_a_law_of_ones_own_is_assessed_by_other_processes(
    capsys: pytest.CaptureFixture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.syspath_prepend(EXAMPLES)

    def run(*words: str) -> dict:
        with pytest.raises(SystemExit) as stop:
            main([*words, "--json"])
        assert not stop.value.code
        return json.loads(capsys.readouterr().out)

    fitted = run("fit", "DMSP-20-300", "--law", "own_law:Gent", "--output", str(tmp_path))
    found = [
        run("assess", str(tmp_path / "fit.json"), "--own", "own_law", "--bootstrap", "260", *more)
        for more in ((), ("--jobs", "2"))
    ]
    drawn = [one["bootstrap"] for one in found]
    assert drawn[0]["replicates"] + drawn[0]["failed"] == 260  # two chunks
    assert drawn[0] == drawn[1]
    assert found[0]["parameters"] == fitted["parameters"]


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({"schema": "famjax-fit/0"}, "must be a fit of schema"),
        ({}, "must be a fit of schema"),
    ],
)
def test_what_holds_no_problem_is_refused(
    document: dict, message: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(document))
    with pytest.raises(SystemExit) as stop:
        main(["assess", str(path), "--validate"])
    assert stop.value.code == 2
    assert re.search(message, capsys.readouterr().err)
