"""`--jobs` of a fit: other processes, the same numbers, with a law of one's own."""

import json
from pathlib import Path

import pytest

from famjax.__main__ import main

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.mark.slow
def test_a_law_of_ones_own_is_fitted_by_other_processes(
    capsys: pytest.CaptureFixture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.syspath_prepend(EXAMPLES)
    found = []
    for more in ((), ("--jobs", "2")):
        with pytest.raises(SystemExit) as stop:
            main(["fit", "DMSP-20-300", "--law", "own_law:Gent", "--starts", "2", "--bootstrap", "260",
                  "--output", str(tmp_path), "--json", *more])  # fmt: skip
        assert not stop.value.code
        found.append(json.loads(capsys.readouterr().out)["bootstrap"])
    assert found[0]["replicates"] + found[0]["failed"] == 260  # two chunks
    assert found[0] == found[1]
