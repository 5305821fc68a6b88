"""What the commands refuse: exit code 2, a sentence that says what to do, nothing printed or written."""

import importlib
from collections.abc import Callable
from pathlib import Path

import pytest

DESIGN = ("design", "--require", "pressure_psi=100")
ASKED = (*DESIGN, "--search", "1e3")
AT = ("--length", "270mm", "--pressure")
FIT_MAP: list[tuple[tuple[str, ...], str]] = [
    (("MAP",), "For several muscles use famjax series"),
    (("--geometry", "a:B", "--shape", "m.nc"), "either --shape or --geometry"),
    (("--law", "ogden", "--order", "2"), "got 2 for ogden: leave the order out"),
    (("--specimen", "braid_angle_deg=65"), "or held by --bounds braid_angle_deg=65"),
    (("--order", "9"), "order of the law must be a whole number 1 to 8"),
    (("--bounds", "E_1_MPa=-3:-2", "--constraint", "positive"), "no coefficients satisfy"),
    (("--bounds", "E_1_MPa=3:2"), "must not exceed"),
    (("--specimen", "colour=red"), "unknown entry of the specimen"),
    (("--prior", "rest_length=300+-1"), "rest_length needs a unit"),
    (("--prior", "rest_length_mm=300"), "must read name_unit=mean+-std"),
    (("--law", "ogden", "--prior", "rest_length_mm=300+-1"), "weighted against the force noise"),
    (("--free", "colour"), "unknown parameter"),
    (("--output", "MAP/below"), "is not a folder"),
]
OTHERS: list[tuple[tuple[str, ...], str]] = [
    (("fit", "DMSP-20-30"), "did you mean DMSP-20-300?"),
    (("fit", "--rest-length", "300mm"), "Unknown option: --rest-length. Try 'famjax fit --help'"),
    (("assess", "MAP"), "name a test: --validate"),
    (("assess", "MAP", "--hysteresis", "MAP"), "is not the branches.csv that famjax ramps"),
    (("predict", "MAP", *AT, "3bar"), "give a fit.json"),
    (("predict", "MAP", *AT, "-3bar"), "parameter --pressure requires an argument"),
    (("rig", "simulat"), "Try 'famjax rig --help'"),
    (("series", "MAP"), "predict --rest-length"),
    (("export", "DMSP-20", "--to", "csv", "--length", "1mm"), "must be above its diameter"),
    (("export", "dmsp-30", "--to", "c"), "dmsp-30"),
    (("export", "dmsp-10", "--to", "fortran"), "fortran"),
    (("export", "dmsp-10", "--to", "c", "--length", "300"), "unit"),
    (("export", "dmsp-10", "--to", "c", "--length", "0mm"), "must be > 0"),
    (("export", "dmsp-10"), "--to"),
    (("measure", "--scale", "90+-0.1 px/in"), "famjax: there are no pictures to measure"),
    ((*DESIGN, "--require", "force_dyn=3"), "force_dyn has the unknown unit 'dyn'"),
    ((*DESIGN, "--require", "contraction=30"), "a fraction in [0, 1)"),
    ((*DESIGN, "--search", "0.5"), "--search must be >= 1"),
    ((*ASKED, "--objective", "width"), "one or more of outer_diameter"),
    ((*ASKED, "--vary", "angle_deg=1:2"), "unknown key 'angle_deg'"),
    ((*ASKED, "--vary", "pressure_psi=1:2:3"), "must be two numbers in brackets, got [1.0, 2.0, 3.0]"),
    ((*ASKED, "--vary", "pressure_psi=20:200"), "above the pressure of the"),
    ((*ASKED, "--vary", "rest_length_mm=300:100"), "0 < least <= greatest"),
    *(((command, "here", "--jobs", "0"), "--jobs")
      for command in ("compare", "assess", "measure", "characterise")),
]  # fmt: skip
# Said before the library is loaded, which takes seconds.
AT_ONCE: list[tuple[tuple[str, ...], str]] = [
    (("fit", "--order", "2.5"), "--order must be a whole number, got '2.5'"),
    (("assess", "x", "--bootstrap", "-5"), "must be 0 (none) or at least 2; got -5"),
    (("sweep", "--order", "9"), "Must be <= 4"),
    (("compare", "--jobs", "x"), "--jobs must be a whole number, got 'x'"),
]
DAMAGED = [  # what is replaced in a map by what, and what is said of it
    ("force_N", "force", (), "column 'force' has no unit"),
    ("100,290", "100,x", (), "row 3: length is 'x', not a number"),
    ("100,290", "100,900", ("--specimen", "rest_length_mm=300"), "longer than its thread"),
    ("100,290", "-40,290", (), "must be >= 0; reading 2 has -40000 in SI units"),
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
def test_a_refusal_says_what_to_do(refused: Callable, words: tuple[str, ...], said: str) -> None:
    refused(words, said)


@pytest.mark.parametrize(("old", "new", "words", "said"), DAMAGED)
def test_a_damaged_map_is_refused_with_its_place(
    refused: Callable, force_map: Path, old: str, new: str, words: tuple[str, ...], said: str
) -> None:
    force_map.write_text(force_map.read_text().replace(old, new, 1))
    refused(("fit", "MAP", *words), said)


@pytest.mark.parametrize(("words", "said"), AT_ONCE)
def test_numbers_out_of_range_are_refused_before_any_work(
    refused: Callable, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], said: str
) -> None:
    def load() -> None:
        raise AssertionError("the library is loaded for a command that cannot run")

    # All are imported before any is changed: each has the function from the first.
    modules = [importlib.import_module(f"fitting.cli.{name}") for name in ("fit", "several")]
    for module in modules:
        monkeypatch.setattr(module, "load_fitting", load)
    refused(words, said)
