"""Tuning: gains by gradients through plants, what they promise, and the plan that they are written into."""

import dataclasses
import tomllib
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from famjax.app.dynamics import feed_forward
from famjax.app.tuning import step_test, tuned_text
from famjax.boundary.errors import InputError
from famjax.control.tuning import (
    Duty,
    Gains,
    _batched,
    _cost,
    _course,
    drawn_circuits,
    expect,
    tune,
)
from famjax.plant import DahlFriction, HydraulicCircuit, LinearMcKibben, Plant, PneumaticCircuit
from famjax.units import INCH, PSI
from rig.plan import read_plan

DUTY = Duty((20 * PSI, 40 * PSI), 0.08 * INCH, 0.04 * INCH, 3.0, 80 * PSI)
PLAN = """[plan] # a test
pressures_psi = [20, 40, 60]
cycles = 1
stroke_in = 1
rate_in_per_s = 0.1
settle_s = 2
[rig]
circuit = "water"
pressure_limit_psi = 80
proportional_counts_per_psi = 3  # of a colleague
integral_counts_per_psi_s = 8
"""


def plants(circuit: object, count: int) -> tuple[list[Plant], np.ndarray]:
    drawn = drawn_circuits(circuit(), count, 1)
    found = [Plant(one, LinearMcKibben(), friction=DahlFriction()) for one in drawn]
    return found, np.array([feed_forward(one) for one in drawn])


@pytest.mark.slow
@pytest.mark.parametrize("circuit", [PneumaticCircuit, HydraulicCircuit])
def test_tuned_gains_hold_unseen_plants_better(circuit: type) -> None:
    some, forwards = plants(circuit, 3)
    found = tune(some, forwards, DUTY, seed=2)
    others, own = plants(circuit, 6)
    before = expect(others[3:], own[3:], Gains.per_psi(3.0, 8.0, 1000.0), DUTY, seed=5)
    after = expect(others[3:], own[3:], found, DUTY, seed=5)
    assert after.rms.max() < 0.7 * before.rms.max()
    steps = np.abs(np.diff([0.0, *DUTY.pressures]))
    assert (after.overshoot / steps).max() < 0.1
    assert after.highest.max() < DUTY.limit


@pytest.mark.slow
def test_the_slope_of_the_cost_is_that_of_its_values() -> None:
    some, forwards = plants(PneumaticCircuit, 2)
    arrays, static = _batched(some)
    course, x = _course(DUTY, 0), np.log([4.0, 8.0, 12.0])

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = _cost(
            arrays, static, jnp.asarray(forwards), jnp.asarray(x), 80 * PSI, *course
        )
        return float(value), np.asarray(slope)

    slope, step = cost(x)[1], 1e-5
    for k, one in enumerate(np.eye(3) * step):
        apart = (cost(x + one)[0] - cost(x - one)[0]) / (2 * step)
        assert slope[k] == pytest.approx(apart, rel=1e-5, abs=1e-7)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"pressures": ()}, "one or more"),
        ({"pressures": (90 * PSI,)}, "below the limit"),
        ({"rate": 0.0}, "must be > 0"),
        ({"settle": 0.5}, "settle above 1 s"),
    ],
)  # fmt: skip
def test_a_duty_that_cannot_be_done_is_refused(change: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        dataclasses.replace(DUTY, **change)


def test_the_text_of_a_plan_keeps_all_but_its_gains(tmp_path: Path) -> None:
    found = tuned_text(PLAN, 12.345678, 40.0, 1.25)
    before, after = tomllib.loads(PLAN), tomllib.loads(found)
    before["plan"]["rise_s"] = 1.25
    before["rig"] |= {"proportional_counts_per_psi": 12.35, "integral_counts_per_psi_s": 40.0}
    assert after == before
    assert "# of a colleague" in found
    assert tuned_text(found, 12.345678, 40.0, 1.25) == found
    path = tmp_path / "plan.toml"
    path.write_text(found)
    assert read_plan(path).plan.rise == 1.25


def test_a_step_test_is_small_and_below_its_own_limit(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    for text, low, high in ((PLAN, 20, 40), (PLAN.replace("20, 40, 60", "30"), 18, 30)):
        path.write_text(text)
        test = step_test(read_plan(path))
        assert sorted(set(test.plan.pressures)) == pytest.approx([low * PSI, high * PSI])
        assert test.pressure_limit == pytest.approx((high + 15) * PSI)
        assert test.plan.stroke < 2e-4


@pytest.mark.slow
@pytest.mark.parametrize("fluid", ["air", "water"])
def test_a_rig_is_tuned_from_its_step_test(run: Callable, tmp_path: Path, fluid: str) -> None:
    plan, journal = tmp_path / "plan.toml", tmp_path / "step" / "test.fam"
    plan.write_text(PLAN.replace("water", fluid))
    assert run("rig", "step", plan, "--simulate", "-o", journal.parent)[0] == 0
    asked = ("rig", "tune", journal, "--plan", plan, "-o", tmp_path / "tuned.toml")
    code, out, _ = run(*asked)
    assert code == 0
    assert "written:" in out
    assert read_plan(tmp_path / "tuned.toml").plan.rise > 0
    other = tmp_path / "other.toml"
    other.write_text(PLAN.replace("water", "air" if fluid == "water" else "water"))
    wrong = (*asked[:3], "--plan", other, "-o", tmp_path / "new.toml")
    for words, said in (
        (asked, "exists"), ((*asked, "--simulate"), "not both"), (wrong, "of a circuit of"),
    ):  # fmt: skip
        code, _, err = run(*words)
        assert code == 2
        assert said in err
