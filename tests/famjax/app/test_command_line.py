"""The command as a person types it: exit codes, what is printed where, what is written."""

import datetime
import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image
from processes import python

import famjax
from fitting import load_fit


@pytest.fixture
def asked(force_map: Path, tmp_path: Path) -> tuple:
    return (
        "fit", force_map, "--order", 2, "--output", tmp_path / "o",
        "--specimen", "nominal_diameter_mm=20", "--bounds", "deadband_pressure_kPa=20",
    )  # fmt: skip


@pytest.mark.slow
def test_json_is_one_object_and_nothing_else(run: Callable, asked: tuple, tmp_path: Path) -> None:
    code, out, _ = run(*asked, "--json", "--units", "us")
    assert code == 0
    fit = json.loads(out)
    wanted = {"rmse_N", "mae_N", "max_error_N", "max_force_N", "n_points", "parameters",
              "coefficients_Pa", "stability_margin_Pa", "kkt_residual", "duality_gap",
              "constraint", "converged"}  # fmt: skip
    assert wanted <= set(fit)
    assert fit["parameters"]["E_1"]["unit"] == "psi"
    assert set(fit["parameters"]["E_1"]) >= {"value", "unit", "stderr", "at_bound"}
    assert fit["rmse_N"] < 0.01  # the map is rounded to 0.1 mN
    assert any("rest length was not given" in warning for warning in fit["warnings"])
    assert {p.name for p in (tmp_path / "o").iterdir()} == {"fit.json", "fit.png", "report.html"}


@pytest.mark.slow
def test_table_for_people(run: Callable, asked: tuple, tmp_path: Path) -> None:
    code, out, _ = run(*asked)
    assert code == 0
    assert len(out.splitlines()) <= 15
    code, out, _ = run(*asked, "--verbose")
    assert code == 0
    shown = ("Parameters", "certificate", "note:", "written:")
    for needed in shown:
        assert needed in out
    fitted = json.loads((tmp_path / "o" / "fit.json").read_text())
    code, out, _ = run(
        "assess", tmp_path / "o" / "fit.json", "--validate", "--profile", "--bootstrap", 8
    )
    assert code == 0
    for needed in (*shown, "Validation", "Profile likelihood", "Bootstrap, 8 replicates"):
        assert needed in out
    saved = json.loads((tmp_path / "o" / "fit.json").read_text())
    assert saved["leave_one_pressure_out"]["rmse_N"] < 0.01  # exact readings are predicted
    assert saved["profiles"]["E_1"]["verdict"] == "identified"
    made_anew = ("data", "parameters", "muscle", "problem", "warnings", "verdict", "reasons")
    assert {key: saved[key] for key in made_anew} == {key: fitted[key] for key in made_anew}
    assert datetime.datetime.fromisoformat(saved["origin"]["date"]).tzinfo is not None
    assert saved["origin"]["command"].startswith("famjax")
    assert saved["origin"]["date"] in (tmp_path / "o" / "report.html").read_text()
    _predict_from(run, tmp_path / "o" / "fit.json")


@pytest.mark.slow
def test_the_picture_of_the_readme_is_that_of_its_command(run: Callable, tmp_path: Path) -> None:
    """A picture says its title in words; docs/fit.png is `famjax fit`'s, copied."""
    assert run("fit", "--output", tmp_path)[0] == 0
    shown = Path(__file__).parents[3] / "docs" / "fit.png"
    found, expected = (Image.open(path).text["Title"] for path in (shown, tmp_path / "fit.png"))
    assert found == expected


def _predict_from(run: Callable, fit: Path) -> None:
    """The saved muscle predicts the reading it was made from, and where it begins to pull."""
    code, out, _ = run(
        "predict", fit, "--length", "280mm,300mm", "--pressure", "3bar", "--onset", "--json"
    )
    assert code == 0
    rows = json.loads(out)
    muscle = load_fit(fit).muscle
    assert rows[0]["force_N"] == pytest.approx(float(muscle.force(0.28, 3e5)), rel=1e-12)
    assert rows[0]["inside"]
    assert not rows[0]["slack"]
    assert rows[3]["onset_pressure_Pa"] == pytest.approx(20e3, rel=1e-6)  # at rest: the deadband
    code, out, _ = run("predict", fit, "--length", "0.2m", "--pressure", "300kPa")
    assert code == 0
    assert "not inside" in out
    code, out, _ = run(
        "predict", fit, "--length", "28cm", "--pressure", "3bar", "--units", "us", "--json"
    )
    (us,) = json.loads(out)
    assert us["force_lbf"] * 4.4482216152605 == pytest.approx(rows[0]["force_N"], rel=1e-12)
    assert us["length_in"] == pytest.approx(28 / 2.54)
    for wrong, message in (("280", "has no unit"), ("280kg", "not a known unit"), ("x", "number")):
        code, _, err = run("predict", fit, "--length", wrong, "--pressure", "3bar")
        assert (code, message in err) == (2, True)


def test_version_and_help(run: Callable) -> None:
    assert run("--version") == (0, f"famjax {famjax.__version__}\n", "")
    code, out, _ = run("fit", "--help")
    assert code == 0
    assert len(set(re.findall(r"│ (?:DATA )?(--[a-zA-Z]+)", out))) <= 18


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A folder with packages of other people by our names; one of them cannot be imported here."""
    (tmp_path / "fitting.py").write_text("")
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig" / "__init__.py").write_text("raise RuntimeError('made for Python 2')\n")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "code"), [(("doctor",), 1), (("fit",), 2), (("rig", "check", "x.fam"), 2)]
)
def test_a_clash_is_named_by_whatever_meets_it(
    foreign: Path, arguments: tuple[str, ...], code: int
) -> None:
    done = python("-m", "famjax", *arguments, cwd=foreign)
    assert done.returncode == code, done.stderr
    said = done.stdout + done.stderr
    assert "not famjax's own 'fitting' package" in said
    assert f"'rig' resolved to {foreign / 'rig' / '__init__.py'}" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("command", "after", "left"),
    [("fit", 0.1, "nothing was written"), ("compare", 0.5, "the same command goes on from there")],
)
def test_an_interrupt_is_answered_whatever_is_going_on(
    tmp_path: Path, command: str, after: float, left: str
) -> None:
    """In the import of a compiled module it would abort, in a callback of JAX it would be lost."""
    code = (
        "import os, signal, sys, threading\n"
        "from famjax.__main__ import main\n"
        f"sys.argv = ['famjax', {command!r}]\n"
        f"threading.Timer({after}, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "main()"
    )
    done = python("-c", code, cwd=tmp_path)
    assert done.returncode == 130
    assert done.stderr.strip().endswith(f"famjax: stopped; {left}" if command == "fit" else left)
    assert "Traceback" not in done.stderr
