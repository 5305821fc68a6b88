"""`famjax fit --posterior` and `--censored` as a user runs them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("blackjax")


@pytest.mark.slow
def test_posterior_of_a_censored_fit(tmp_path: Path) -> None:
    words = ["fit", "DMSP-10-250", "--censored", "--posterior", "--starts", "4", "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "famjax", *words, "--output", str(tmp_path / "out")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode in {0, 1}, done.stderr
    told = json.loads(done.stdout)["posterior"]
    assert told["coefficients"] == "sampled"
    assert set(told["parameters"]) >= {"braid_diameter", "E_1", "noise"}
    assert all(one["r_hat"] < 1.02 for one in told["parameters"].values())
    assert (tmp_path / "out" / "posterior.png").read_bytes()[:4] == b"\x89PNG"
    assert "Posterior, 4 chains" in (tmp_path / "out" / "report.html").read_text()
