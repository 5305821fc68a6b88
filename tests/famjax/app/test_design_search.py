"""`famjax design`: files and exit codes."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest

ASKED = (
    "--require", "pressure_psi=100", "--require", "force_lbf=400", "--require", "stroke_in=2",
    "--require", "longest_length_in=18",
)  # fmt: skip


@pytest.mark.slow
def test_files_of_a_search(run: Callable, tmp_path: Path) -> None:
    code, out, _ = run(
        "design", *ASKED, "--units", "us", "--search", "2e3", "--vary", "pressure_psi=40:100", "--json",
        "--output", tmp_path,
    )  # fmt: skip
    assert code == 0
    document = json.loads(out)
    assert json.loads((tmp_path / "design.json").read_text()) == document
    assert document["origin"]["command"].startswith("famjax")
    asked = document["search"]
    assert asked["asked_si"]["stroke"] == pytest.approx(0.0508)
    # From a quarter of the longest length to all of it.
    assert asked["ranges_si"]["rest_length"] == pytest.approx([0.1143, 0.4572])
    for row in document["front"]:
        assert row["force_lbf"] >= 400
        assert row["stroke_in"] >= 2
        assert 40 * (1 - 1e-12) <= row["pressure_psi"] <= 100 * (1 + 1e-12)
    (refined,) = document["refined"]
    assert refined["stroke_in"] >= 2
    assert any(row["feasible"] for row in document["end_fittings"])
    with (tmp_path / "feasible.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == asked["feasible"]


def test_nothing_feasible_is_said_with_exit_code_1(run: Callable, tmp_path: Path) -> None:
    code, out, _ = run(
        "design", "--require", "pressure_psi=60", "--require", "force_lbf=1500", "--require",
        "stroke_in=2", "--search", 2000, "--units", "us", "--output", tmp_path,
    )  # fmt: skip
    assert code == 1
    assert "fail the force" in out
    assert "Nearest miss" in out
    document = json.loads((tmp_path / "design.json").read_text())
    assert (document["front"], document["refined"]) == ([], [])
    assert [path.name for path in tmp_path.iterdir()] == ["design.json"]
