"""The command as a person types it: exit codes, what is printed where, what is written."""

import datetime
import importlib
import io
import json
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

import famjax
from famjax.__main__ import main
from fitting import load_fit


def run(capsys: pytest.CaptureFixture, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    captured = capsys.readouterr()
    return int(stop.value.code or 0), captured.out, captured.err


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    """A force map of a known muscle with two strange readings to be removed by tests."""
    braid = famjax.Braid.from_rest(diameter=0.022, braid_angle=1.13, length=0.3)
    bladder = famjax.Bladder(0.3, 0.022, 0.002, embedded=True)
    muscle = famjax.Muscle(
        famjax.EstimatedGeometry(braid, bladder), famjax.PolynomialMaterial([3e6, -2e6]), 2e4
    )
    rows = ["pressure_kPa,length_mm,force_N"]
    rows += [
        f"{P},{L},{max(0.0, float(muscle.force(L / 1e3, P * 1e3))):.4f}"
        for P in (100, 200, 300, 400)
        for L in (300, 290, 280, 270)
    ]
    path = tmp_path / "map.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_json_is_one_object_and_nothing_else(
    capsys: pytest.CaptureFixture, map_file: Path, tmp_path: Path
) -> None:
    code, out, _ = run(
        capsys, "fit", map_file, "--order", 2, "--json", "--output", tmp_path / "o",
        "--specimen", "nominal_diameter_mm=20", "--bounds", "deadband_pressure_kPa=20",
        "--units", "us",
    )  # fmt: skip
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
def test_table_for_people(capsys: pytest.CaptureFixture, map_file: Path, tmp_path: Path) -> None:
    code, out, _ = run(
        capsys, "fit", map_file, "--order", 2, "--output", tmp_path / "o",
        "--specimen", "nominal_diameter_mm=20", "--bounds", "deadband_pressure_kPa=20",
    )  # fmt: skip
    assert code == 0
    shown = ("Parameters", "braid_angle", "held", "RMSE", "Certificate", "note:", "written:")
    for needed in shown:
        assert needed in out
    fitted = json.loads((tmp_path / "o" / "fit.json").read_text())
    code, out, _ = run(
        capsys, "assess", tmp_path / "o" / "fit.json", "--validate", "--profile", "--bootstrap", 8
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
    _predict_from(capsys, tmp_path / "o" / "fit.json")


@pytest.mark.slow
def test_the_picture_of_the_readme_is_that_of_its_command(
    capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    """A picture says its title in words; docs/fit.png is `famjax fit`'s, copied."""
    assert run(capsys, "fit", "--output", tmp_path)[0] == 0
    shown = Path(__file__).parents[3] / "docs" / "fit.png"
    found, expected = (Image.open(path).text["Title"] for path in (shown, tmp_path / "fit.png"))
    assert found == expected


def _predict_from(capsys: pytest.CaptureFixture, fit: Path) -> None:
    """The saved muscle predicts the reading it was made from, and where it begins to pull."""
    code, out, _ = run(
        capsys, "predict", fit, "--length", "280mm,300mm", "--pressure", "3bar", "--onset", "--json"
    )
    assert code == 0
    rows = json.loads(out)
    muscle = load_fit(fit).muscle
    assert rows[0]["force_N"] == pytest.approx(float(muscle.force(0.28, 3e5)), rel=1e-12)
    assert rows[0]["inside"]
    assert not rows[0]["slack"]
    assert rows[3]["onset_pressure_Pa"] == pytest.approx(20e3, rel=1e-6)  # at rest: the deadband
    code, out, _ = run(capsys, "predict", fit, "--length", "0.2m", "--pressure", "300kPa")
    assert code == 0
    assert "not inside" in out
    code, out, _ = run(capsys, "predict", fit, "--length", "11in", "--pressure", "3bar")
    assert (code, "length in  pressure bar  force N" in out) == (0, True)
    code, out, _ = run(
        capsys, "predict", fit, "--length", "28cm", "--pressure", "3bar", "--units", "us", "--json"
    )
    (us,) = json.loads(out)
    assert us["force_lbf"] * 4.4482216152605 == pytest.approx(rows[0]["force_N"], rel=1e-12)
    assert us["length_in"] == pytest.approx(28 / 2.54)
    for wrong, message in (("280", "has no unit"), ("280kg", "not a known unit"), ("x", "number")):
        code, _, err = run(capsys, "predict", fit, "--length", wrong, "--pressure", "3bar")
        assert (code, message in err) == (2, True)


@pytest.mark.parametrize(
    ("spoil", "arguments", "message"),
    [
        (("force_N", "force"), (), "column 'force' has no unit"),
        (("100,290", "100,x"), (), "row 3: length is 'x', not a number"),
        (("100,290", "100,900"), ("--specimen", "rest_length_mm=300"), "longer than its thread"),
        (("100,290", "-1,290"), (), "gauge pressure must be >= 0"),
        (None, ("--order", "9"), "order of the law must be a whole number 1 to 8"),
        (None, ("--order", "many"), "order"),
        (None, ("--constraint", "odd"), "constraint"),
        (
            None,
            ("--bounds", "E_1_MPa=-3:-2", "--constraint", "positive"),
            "no coefficients satisfy",
        ),
        (None, ("--bounds", "E_1_MPa=3:2"), "must not exceed"),
        (None, ("--specimen", "colour=red"), "unknown entry of the specimen"),
        (None, ("--prior", "rest_length=300+-1"), "rest_length needs a unit"),
        (None, ("--prior", "rest_length_mm=300"), "must read name_unit=mean+-std"),
        (
            None,
            ("--law", "ogden", "--prior", "rest_length_mm=300+-1"),
            "weighed against the noise",
        ),
        (None, ("--free", "colour"), "unknown parameter"),
        (None, ("--spam",), "spam"),
    ],
)
def test_bad_input_is_explained_with_exit_code_2(
    capsys: pytest.CaptureFixture,
    map_file: Path,
    tmp_path: Path,
    spoil: tuple[str, str] | None,
    arguments: tuple[str, ...],
    message: str,
) -> None:
    if spoil:
        map_file.write_text(map_file.read_text().replace(*spoil, 1))
    output = tmp_path / "out"
    code, out, err = run(capsys, "fit", map_file, "--output", output, *arguments)
    assert code == 2
    assert message in err
    assert "Traceback" not in err
    assert out == ""
    assert not output.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fit", "--order", 2.5), "--order must be a whole number, got '2.5'"),
        (("assess", "fit.json", "--bootstrap", -5), "0, for no replicates, or 2 and more; got -5"),
        (("sweep", "--order", 9), "Must be <= 4"),
        (("sweep", "--order", 1, "--order", 2.5), "--order must be a whole number, got '2.5'"),
        (("compare", "--jobs", 0), "Must be >= 1"),
        (("series", "--jobs", "x"), "--jobs must be a whole number, got 'x'"),
    ],
)
def test_numbers_out_of_range_are_refused_before_any_work(
    capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    arguments: tuple[object, ...],
    message: str,
) -> None:
    def load() -> None:
        raise AssertionError("the library is loaded for a command that cannot run")

    # All are imported before any is changed: each has the function from the first.
    modules = [importlib.import_module(f"fitting.cli.{name}") for name in ("fit", "several")]
    for module in modules:
        monkeypatch.setattr(module, "load_fitting", load)
    code, out, err = run(capsys, *arguments, "--output", tmp_path / "o")
    assert (code, out) == (2, "")
    assert message in err
    assert "--" in err
    assert not (tmp_path / "o").exists()


def test_missing_file_and_blocked_output(
    capsys: pytest.CaptureFixture, map_file: Path, tmp_path: Path
) -> None:
    code, _, err = run(capsys, "fit", tmp_path / "none.csv", "--output", tmp_path / "o")
    assert (code, "no such file" in err) == (2, True)
    code, _, err = run(capsys, "fit", map_file, "--output", map_file / "below")
    assert (code, "is not a folder" in err) == (2, True)


def test_the_league_table_says_what_was_left_out(
    capsys: pytest.CaptureFixture, map_file: Path, tmp_path: Path
) -> None:
    code, out, _ = run(
        capsys,
        "compare",
        map_file,
        "--models",
        "gaylord",
        "--output",
        tmp_path / "o",
    )
    assert code == 0
    assert "inner lengths out N  rmse N  pressures out N  lengths out N" in out
    assert "lolo" not in out


def test_version_and_help(capsys: pytest.CaptureFixture) -> None:
    assert run(capsys, "--version") == (0, f"famjax {famjax.__version__}\n", "")
    code, out, _ = run(capsys, "fit", "--help")
    assert code == 0
    for option in ("--order", "--constraint", "--bounds", "--specimen", "--output", "--units",
                   "--json", "Data", "Model", "What you know", "Output"):  # fmt: skip
        assert option in out


@pytest.mark.slow
def test_doctor_reports_versions_and_devices() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "famjax", "doctor"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for needed in (f"famjax {famjax.__version__}", "jax ", "devices: ", "float64: ", "no problems"):
        assert needed in done.stdout
    for name in ("mujoco", "optax", "blackjax"):
        assert f"  {name} " in done.stdout


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A folder with packages of other people by our names; one of them cannot be imported here."""
    (tmp_path / "fitting.py").write_text("")
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig" / "__init__.py").write_text("raise RuntimeError('made for Python 2')\n")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("doctor",), 1),
        (("fit",), 2),
        (("predict", "x", "--length", "1m"), 2),
        (("rig", "ports"), 2),
    ],
)
def test_a_clash_is_named_by_whatever_meets_it(
    foreign: Path, arguments: tuple[str, ...], code: int
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "famjax", *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=foreign,
    )
    assert done.returncode == code, done.stderr
    said = done.stdout + done.stderr
    assert "not famjax's own 'fitting' package" in said
    assert f"'rig' resolved to {foreign / 'rig' / '__init__.py'}" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("command", "left"),
    [("fit", "nothing was written"), ("compare", "the same command goes on from there")],
)
@pytest.mark.parametrize("after", [0.1, 0.5])
def test_an_interrupt_is_answered_whatever_is_going_on(
    tmp_path: Path, command: str, left: str, after: float
) -> None:
    """In the import of a compiled module it would abort, in a callback of JAX it would be lost."""
    code = (
        "import os, signal, sys, threading\n"
        "from famjax.__main__ import main\n"
        f"sys.argv = ['famjax', {command!r}]\n"
        f"threading.Timer({after}, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == 130
    assert done.stderr.strip().endswith(f"famjax: stopped; {left}" if command == "fit" else left)
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_map_comes_from_standard_input_and_what_is_replaced_is_told(
    map_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    text = map_file.read_text()
    for replaced in (False, True):
        monkeypatch.setattr(sys, "stdin", io.StringIO(text))
        code, said, _ = run(capsys, "fit", "-", "--law", "polynomial", "--output", tmp_path / "out")
        assert code == 0
        assert (
            "fit.json, fit.png, report.html took the place of earlier files" in said
        ) == replaced
