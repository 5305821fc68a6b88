"""Every example runs as a user would run it, and says what it promises."""

import re
from pathlib import Path

import pytest
from processes import said

FOLDER = Path(__file__).parents[1] / "examples"
BEST = 7.52544  # N: the optimum of the cubic law in the bounds of a muscle that can be built


def of(name: str) -> str:
    return said(FOLDER / f"{name}.py", cwd=FOLDER)


def test_a_law_of_ones_own() -> None:
    assert "stable: True" in of("own_law")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fit_optimistix", "fit_optax"])
def test_foreign_solvers_reach_the_optimum(name: str) -> None:
    (rmse,) = re.findall(r"RMSE ([\d.]+) N", of(name))
    assert float(rmse) == pytest.approx(BEST, abs=1e-3)


@pytest.mark.slow
def test_a_joint_in_mujoco() -> None:
    pytest.importorskip("mujoco")
    told = of("mujoco_joint")
    (held, stiffness), *_ = re.findall(r"held at ([\d.]+) rad; stiffness ([\d.]+)", told)
    assert float(held) == pytest.approx(0.4, abs=1e-6)
    assert float(stiffness) == pytest.approx(9.0, rel=0.01)  # the secant of a push of 3 degrees


@pytest.mark.slow
@pytest.mark.timeout(200)
def test_engines() -> None:
    (names, same) = re.findall(r"the same on (.+): (\w+)", of("engines"))[0]
    assert names.startswith("this process, two processes, concurrent.futures")
    assert same == "True"


@pytest.mark.slow
def test_nuts() -> None:
    told = of("nuts_blackjax")
    (accepted,) = re.findall(r"accepted ([\d.]+)", told)
    assert 0.6 < float(accepted) < 1
    assert "deadband_pressure" in told


def test_examples_are_short() -> None:
    for file in FOLDER.glob("*.py"):
        lines = len(file.read_text().splitlines())
        assert lines < (90 if file.stem.endswith("_tutorial") else 40), file
