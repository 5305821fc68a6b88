"""`famjax assess --posterior` of a `famjax fit --objective censored`, as a user runs them."""

import json
from pathlib import Path

import pytest

from famjax.__main__ import main

pytest.importorskip("blackjax")


@pytest.mark.slow
def test_posterior_of_a_censored_fit(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    out = tmp_path / "out"
    for words in (
        ("fit", "DMSP-10-250", "--objective", "censored", "--output", out),
        ("assess", out / "fit.json", "--posterior"),
    ):
        with pytest.raises(SystemExit) as stop:
            main([*map(str, words), "--json"])
        assert stop.value.code in {None, 0, 1}
    told = json.loads(capsys.readouterr().out.splitlines()[-1])["posterior"]
    assert told["coefficients"] == "sampled"
    assert set(told["parameters"]) >= {"braid_diameter", "E_1", "noise"}
    assert all(one["r_hat"] < 1.02 for one in told["parameters"].values())
    assert "Posterior, 4 chains" in (out / "report.html").read_text()
