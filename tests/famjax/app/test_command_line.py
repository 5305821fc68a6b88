"""The command as a person types it: start, exit codes, what is printed where, what is refused."""

import csv
import datetime
import importlib
import inspect
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from processes import python

import famjax
from famjax.app import cli
from fitting import load_fit
from rig import cli as rig_cli


@pytest.mark.slow
def test_a_fit_as_a_table_and_as_json_and_what_is_assessed_of_it(said, force_map, tmp_path):
    asked = ("fit", force_map, "--order", 2, "--output", tmp_path / "o",
             "--specimen", "nominal_diameter_mm=20", "--bounds", "deadband_pressure_kPa=20")  # fmt: skip
    fit = json.loads(said(*asked, "--json", "--units", "us"))
    wanted = {"rmse_N", "max_error_N", "max_force_N", "n_points", "parameters",
              "coefficients_Pa", "stability_margin_Pa", "kkt_residual", "duality_gap",
              "constraint", "converged"}  # fmt: skip
    assert wanted <= set(fit)
    assert fit["parameters"]["E_1"]["unit"] == "Pa"
    assert set(fit["parameters"]["E_1"]) >= {"value", "unit", "stderr", "at_bound"}
    assert fit["rmse_N"] < 0.01  # the map is rounded to 0.1 mN
    assert any("rest length was not given" in warning for warning in fit["warnings"])
    assert {p.name for p in (tmp_path / "o").iterdir()} == {"fit.json", "fit.png", "report.html"}
    assert len(said(*asked).splitlines()) <= 15
    shown, out = ("Parameters", "note:", "written:"), said(*asked, "--verbose")
    assert all(needed in out for needed in shown)
    file = tmp_path / "o" / "fit.json"
    fitted = json.loads(file.read_text())
    out = said("assess", file, "--validate", "--profile", "--bootstrap", 8)
    for needed in (*shown, "Validation", "profile likelihood", "bootstrap with 8 replicates"):
        assert needed in out
    saved = json.loads(file.read_text())
    assert saved["leave_one_pressure_out"]["rmse_N"] < 0.01  # exact readings are predicted
    assert saved["profiles"]["E_1"]["verdict"] == "identified"
    made_anew = ("data", "parameters", "muscle", "problem", "warnings", "verdict", "reasons")
    assert {key: saved[key] for key in made_anew} == {key: fitted[key] for key in made_anew}
    assert datetime.datetime.fromisoformat(saved["origin"]["date"]).tzinfo is not None
    assert saved["origin"]["command"].startswith("famjax")
    assert saved["origin"]["date"] in (tmp_path / "o" / "report.html").read_text()
    states = "--length", "280mm,300mm", "--pressure", "3bar"
    rows = json.loads(said("predict", file, *states, "--onset", "--json"))
    muscle = load_fit(file).muscle
    assert rows[0]["force_N"] == pytest.approx(float(muscle.force(0.28, 3e5)), rel=1e-12)
    assert rows[0]["inside"]
    assert not rows[0]["slack"]
    assert rows[3]["onset_pressure_Pa"] == pytest.approx(20e3, rel=1e-6)  # at rest: the deadband
    out = said("predict", file, "--length", "0.2m", "--pressure", "300kPa")
    assert "where inside is False" in out
    out = said("predict", file, "--length", "10in", "--pressure", "3bar", "--units", "us")
    assert "length in pressure psi force lbf" in " ".join(out.split())


@pytest.mark.slow
def test_the_picture_of_the_readme_is_that_of_its_command(said, tmp_path):
    """A picture says its title in words; docs/fit.png is `famjax fit`'s, copied."""
    said("fit", "--output", tmp_path)
    shown = Path(__file__).parents[3] / "docs" / "fit.png"
    found, expected = (Image.open(path).text["Title"] for path in (shown, tmp_path / "fit.png"))
    assert found == expected


@pytest.mark.parametrize(
    ("arguments", "code"), [(("doctor",), 1), (("fit",), 2), (("rig", "check", "x.fam"), 2)]
)
def test_a_clash_with_packages_of_others_is_named_by_whatever_meets_it(tmp_path, arguments, code):
    (tmp_path / "fitting.py").write_text("")
    rig = tmp_path / "rig" / "__init__.py"
    rig.parent.mkdir()
    rig.write_text("raise RuntimeError('made for Python 2')\n")
    done = python("-m", "famjax", *arguments, cwd=tmp_path)
    assert done.returncode == code, done.stderr
    said = done.stdout + done.stderr
    assert "not famjax's own 'fitting' package" in said
    assert f"Python finds 'rig' at {rig}" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("command", "after", "left"),
    [("fit", 0.1, "nothing was written"), ("compare", 0.5, "run the same command again to resume")],
)
def test_an_interrupt_is_answered_whatever_is_going_on(tmp_path, command, after, left):
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


HEAVY = ("jax", "numpy", "scipy", "matplotlib", "pint", "cv2", "skimage", "serial", "jinja2")


def loaded(code: str) -> set[str]:
    """Top-level packages in a fresh process that has run the code."""
    code += "\nimport sys; print('loaded:', *sorted({m.partition('.')[0] for m in sys.modules}))"
    done = python("-c", code)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("loaded:")[2].split())


def test_importing_the_library_loads_nothing_until_a_name_is_used():
    assert not loaded("import famjax, fitting; famjax.units; fitting.InputError") & set(HEAVY)
    used = loaded(
        "from famjax import Muscle; from fitting import read_csv; from jax._src import xla_bridge\n"
        "assert not xla_bridge.backends_are_initialized()\n"
        "assert not __import__('jax').config.read('jax_enable_x64')"
    )
    assert "jax" in used
    assert not used & {"cv2", "skimage", "serial", "matplotlib", "pint"}
    assert not loaded("import imaging, rig") & (set(HEAVY) - {"numpy", "scipy"})
    assert not loaded("import famjax.units") & set(HEAVY)
    assert "jax" in loaded("import famjax.peers; famjax.peers.TonduLopez; famjax.Muscle")
    assert famjax.units is sys.modules["famjax.units"]


def commands() -> list[tuple[tuple[str, ...], str, str]]:
    """What a person types, the function behind it, and the sentence that the help shows for it."""
    every = [((), path, cli.sentence(path)) for path in cli.COMMANDS]
    every += [(("rig",), path, cli.sentence(path)) for path in cli.RIG_COMMANDS]
    for function in rig_cli.COMMANDS:
        sentence = (inspect.getdoc(function) or "").split("\n\n")[0]
        every.append((("rig",), f"rig.cli:{function.__name__}", sentence))
    return [
        ((*group, path.partition(":")[2].removeprefix("rig_").replace("_", "-")), path, sentence)
        for group, path, sentence in every
    ]


@pytest.mark.parametrize(("words", "path", "sentence"), commands())
def test_a_command_is_listed_with_its_sentence_and_a_text_for_every_option(
    words, path, sentence, capsys
):
    module, _, name = path.partition(":")
    docstring = inspect.getdoc(getattr(importlib.import_module(module), name)) or ""
    assert docstring.split("\n\n")[0] == sentence
    cli.command_line([*words, "--help"])([*words, "--help"], result_action="return_value")
    shown = " ".join(capsys.readouterr().out.split())
    for paragraph in docstring.partition("\n\nParameters\n")[0].split("\n\n"):
        assert " ".join(paragraph.replace("`", "").split()) in shown
    assert "--empty-" not in shown  # of a list: no option that means nothing
    asked = cli.command_line([*words])
    for word in words:
        asked = asked[word]
    for option in asked.assemble_argument_collection(parse_docstring=True):
        if option.parse and not option.has_tokens and option.show:
            assert option.parameter.help, option.names


def test_help_loads_no_library(run):
    assert run("--version") == (0, f"famjax {famjax.__version__}\n", "")
    assert len(set(re.findall(r"│ (?:DATA )?(--[a-zA-Z]+)", run("fit", "--help")[1]))) <= 18
    code = """
from famjax.__main__ import main
for words in ("", "fit", "assess", "predict", "measure", "rig", "rig simulate", "doctor"):
    try:
        main([*words.split(), "--help"])
    except SystemExit:
        pass
"""
    assert not loaded(code) & set(HEAVY)


def start(*arguments: object, **streams: object) -> subprocess.Popen:
    command = [sys.executable, "-m", "famjax", *map(str, arguments)]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    return subprocess.Popen(command, env=environment, **streams)  # type: ignore[call-overload]


@pytest.mark.slow
def test_a_name_that_the_terminal_cannot_show_is_no_reason_to_end(tmp_path):
    done = start(
        "fit", "DMSP-10-250", "--specimen", "name=M\u00fcller \u2116 7", "--law", "neo-hookean",
        "--output", tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    out, told = done.communicate(timeout=120)
    assert (done.returncode, told) == (0, b"")
    assert rb"M\xfcller \u2116 7  (bundled map" in out


def test_a_reader_that_has_left_is_no_error():
    """As in `famjax doctor | head -1`."""
    read, write = os.pipe()
    os.close(read)
    done = start("doctor", stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    _, told = done.communicate(timeout=120)
    assert (done.returncode, told) == (141, b"")


@pytest.mark.slow
def test_the_shape_of_a_bundled_muscle(said, run, tmp_path):
    asked = ("shape", "DMSP-20", "--pressure", "500kPa", "-o", tmp_path / "shape")
    found = json.loads(said(*asked, "--length", "270mm", "--json"))
    assert 200 < found["force_N"] < 1600
    names = (tmp_path / "shape/shape.csv").read_text().partition("\n")[0].split(",")
    assert {"position_mm", "diameter_mm", "braid_angle_deg", "thread_tension_N"} <= {*names}
    table = np.genfromtxt(tmp_path / "shape/shape.csv", delimiter=",", names=True)
    assert table["position_mm"][-1] == pytest.approx(270, abs=1e-6)
    assert max(table["diameter_mm"]) == pytest.approx(1e3 * found["largest_diameter_m"])
    code, _, err = run(*asked, "--length", "900mm")
    assert code == 2
    assert "no stable shape" in err


def required(*words: str) -> list[str]:
    return [one for word in words for one in ("--require", word)]


@pytest.mark.slow
def test_files_of_a_design_search(said, tmp_path):
    out = said(
        "design", *required("pressure_psi=100", "force_lbf=400", "stroke_in=2", "longest_length_in=18"),
        "--units", "us", "--search", "2e3", "--vary", "pressure_psi=40:100", "--json", "--output", tmp_path,
    )  # fmt: skip
    document = json.loads(out)
    assert json.loads((tmp_path / "design.json").read_text()) == document
    assert document["origin"]["command"].startswith("famjax")
    asked = document["search"]
    assert asked["asked_si"]["stroke"] == pytest.approx(0.0508)
    # From a quarter of the longest length to all of it.
    assert asked["ranges_si"]["rest_length"] == pytest.approx([0.1143, 0.4572])
    for row in document["front"]:
        assert (row["force_lbf"] >= 400, row["stroke_in"] >= 2) == (True, True)
        assert 40 * (1 - 1e-12) <= row["pressure_psi"] <= 100 * (1 + 1e-12)
    (refined,) = document["refined"]
    assert refined["stroke_in"] >= 2
    assert refined["diameter_on_bladder_in"] < refined["diameter_on_braid_in"]
    with (tmp_path / "feasible.csv").open() as file:
        assert len([*csv.DictReader(file)]) == asked["feasible"]


def test_a_design_that_nothing_meets_ends_1(run, tmp_path):
    wanted = required("pressure_psi=60", "force_lbf=1500", "stroke_in=2")
    code, out, _ = run("design", *wanted, "--search", 2000, "--units", "us", "--output", tmp_path)
    assert code == 1
    assert "fail the force" in out
    assert "Nearest miss" in out
    document = json.loads((tmp_path / "design.json").read_text())
    assert (document["front"], document["refined"]) == ([], [])
    assert [path.name for path in tmp_path.iterdir()] == ["design.json"]


DESIGN = ("design", "--require", "pressure_psi=100")
ASKED = (*DESIGN, "--search", "1e3")
AT = ("--length", "270mm", "--pressure")
FIT_MAP: list[tuple[tuple[str, ...], str]] = [
    (("MAP",), "For several muscles use famjax series"),
    (("--geometry", "a:B", "--shape", "m.nc"), "either --shape or --geometry"),
    (("--law", "ogden", "--order", "2"), "got 2 for ogden: omit the order"),
    (("--specimen", "braid_angle_deg=65"), "or fix it with --bounds braid_angle_deg=65"),
    (("--order", "9"), "order of the law must be a whole number from 1 to 8"),
    (("--bounds", "E_1_MPa=-3:-2", "--constraint", "positive"), "no coefficients satisfy"),
    (("--bounds", "E_1_MPa=3:2"), "must not exceed"),
    (("--specimen", "colour=red"), "unknown specimen entry"),
    (("--prior", "rest_length=300+-1"), "'' is not a known unit of length"),
    (("--prior", "rest_length_mm=300"), "must have the form name_unit=mean+-std"),
    (("--law", "ogden", "--prior", "rest_length_mm=300+-1"), "weighted against the force noise"),
    (("--free", "colour"), "unknown parameter"),
    (("--output", "MAP/below"), "must be a folder"),
]
OTHERS: list[tuple[tuple[str, ...], str]] = [
    (("fit", "DMSP-20-30"), "did you mean DMSP-20-300?"),
    (("fit", "--rest-length", "300mm"), "Unknown option: --rest-length. Try 'famjax fit --help'"),
    (("assess", "MAP"), "choose a test: --validate"),
    (("assess", "MAP", "--hysteresis", "MAP"), "must be a branches.csv written by famjax ramps"),
    (("predict", "MAP", *AT, "3bar"), "choose a fit.json"),
    *((("predict", "MAP", "--length", wrong, "--pressure", "3bar"), said) for wrong, said in (
        ("280", "has no unit"), ("280kg", "not a known unit"), ("x", "number"))),
    (("predict", "MAP", *AT, "-3bar"), "parameter --pressure requires an argument"),
    (("rig", "simulat"), "Try 'famjax rig --help'"),
    (("series", "MAP"), "predict --rest-length"),
    (("export", "DMSP-20", "--to", "csv", "--length", "1mm"), "must exceed the braid diameter"),
    (("export", "dmsp-30", "--to", "c"), "dmsp-30"),
    (("export", "dmsp-10", "--to", "fortran"), "fortran"),
    (("export", "dmsp-10", "--to", "c", "--length", "300"), "unit"),
    (("export", "dmsp-10", "--to", "c", "--length", "0mm"), "must be > 0"),
    (("export", "dmsp-10"), "--to"),
    (("measure", "--scale", "90+-0.1 px/in"), "famjax: there are no pictures to measure"),
    ((*DESIGN, "--require", "force_dyn=3"), "unknown key 'force_dyn'"),
    ((*DESIGN, "--require", "contraction=30"), "a fraction in [0, 1)"),
    ((*DESIGN, "--search", "0.5"), "--search must be >= 1"),
    ((*ASKED, "--objective", "width"), "one or more of outer_diameter"),
    ((*ASKED, "--vary", "angle_deg=1:2"), "unknown key 'angle_deg'"),
    ((*ASKED, "--vary", "pressure_psi=1:2:3"), "must be two numbers in brackets, got [1.0, 2.0, 3.0]"),
    ((*ASKED, "--vary", "pressure_psi=20:200"), "above the required supply pressure"),
    ((*ASKED, "--vary", "rest_length_mm=300:100"), "0 < lowest <= highest"),
    *(((command, "here", "--jobs", "0"), "--jobs")
      for command in ("compare", "assess", "measure", "characterise")),
]  # fmt: skip
# Said before the library is loaded, which takes seconds.
AT_ONCE: list[tuple[tuple[str, ...], str]] = [
    (("fit", "--order", "2.5"), "--order must be a whole number, got '2.5'"),
    (("assess", "x", "--bootstrap", "-5"), "Must be >= 2"),
    (("sweep", "--order", "9"), "Must be <= 4"),
    (("compare", "--jobs", "x"), "--jobs must be a whole number, got 'x'"),
]
DAMAGED = [  # what is replaced in a map by what, and what is said of it
    ("force_N", "force", (), "column 'force' has no unit"),
    ("100,290", "100,x", (), "row 3: length is 'x', not a number"),
    ("100,290", "100,900", ("--specimen", "rest_length_mm=300"), "which exceeds the thread length"),
    ("100,290", "-40,290", (), "pressure of reading 2 is -40000 in SI units"),
]


@pytest.fixture
def refused(run: Callable, monkeypatch: pytest.MonkeyPatch, force_map: Path) -> Callable:
    monkeypatch.chdir(force_map.parent)

    def check(words: tuple[str, ...], said: str) -> None:
        code, out, err = run(*(word.replace("MAP", str(force_map)) for word in words))
        assert (code, out) == (2, "")
        assert said in " ".join(err.split())
        for internal in ("Traceback", "class '", "Equinox"):
            assert internal not in err
        assert [*force_map.parent.iterdir()] == [force_map]

    return check


@pytest.mark.parametrize(
    ("words", "said"), [*((("fit", "MAP", *words), said) for words, said in FIT_MAP), *OTHERS]
)
def test_a_refusal_says_what_to_do(refused, words, said):
    refused(words, said)


@pytest.mark.parametrize(("old", "new", "words", "said"), DAMAGED)
def test_a_damaged_map_is_refused_with_its_place(refused, force_map, old, new, words, said):
    force_map.write_text(force_map.read_text().replace(old, new, 1))
    refused(("fit", "MAP", *words), said)


@pytest.mark.parametrize(("words", "said"), AT_ONCE)
def test_numbers_out_of_range_are_refused_before_any_work(refused, monkeypatch, words, said):
    def load() -> None:
        raise AssertionError("the library is loaded for a command that cannot run")

    # All are imported before any is changed: each has the function from the first.
    modules = [importlib.import_module(f"fitting.cli.{name}") for name in ("fit", "several")]
    for module in modules:
        monkeypatch.setattr(module, "load_fitting", load)
    refused(words, said)
