"""Plans: listed, timed, resumed and read from files with units."""

from pathlib import Path

import pytest

from famjax.boundary.errors import InputError
from rig.cli import PRECONDITIONS, describe
from rig.plan import Isobaric, duration, next_block, read_plan, seconds_of

PSI = 6894.757293168361
PLAN = Isobaric((1e5, 3e5, 2e5), cycles=2, stroke=0.05, rate=0.001, settle=4.0)


def test_a_plan_is_the_same_tuples_every_time() -> None:
    steps = list(PLAN.steps())
    assert steps == list(PLAN.steps())
    assert all(type(step) is tuple for step in steps)
    assert steps[:5] == [
        ("block", 0, 1e5),
        ("set", 1e5),
        ("wait", 4.0),
        ("strokes", 0, 2, 200.0, 0.05, 0.001, 0.0),
        ("done", 0),
    ]
    assert len(steps) == 15


def test_duration_is_settling_and_strokes() -> None:
    assert duration(PLAN) == pytest.approx(3 * (4 + 2 * 2 * 0.05 / 0.001))
    assert duration(PLAN, 2) == pytest.approx(204)
    assert duration(PLAN, 3) == 0


def test_a_plan_is_listed_with_its_times() -> None:
    lines = describe(PLAN)
    assert len(lines) == 15
    assert lines[3] == "     4.0 s  2 cycles, 200 s: stroke 0.05 m at 0.001 m/s"
    assert lines[5].startswith("   204.0 s  block 1: 300000 Pa")
    assert sum(seconds_of(step) for step in PLAN.steps()) == duration(PLAN)


def test_a_plan_goes_on_with_the_block_that_was_not_done() -> None:
    notes = [
        {"note": "block", "block": 0},
        {"note": "done", "block": 0},
        {"note": "block", "block": 1},
    ]
    assert next_block(notes) == 1
    assert next(PLAN.steps(next_block(notes))) == ("block", 1, 3e5)
    assert next_block([]) == 0
    with pytest.raises(InputError, match=r"cannot start at 4"):
        list(PLAN.steps(4))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pressures": ()}, "one pressure at least"),
        ({"pressures": (1e5, -1.0)}, r"each a number >= 0 and finite, got \(100000.0, -1.0\)"),
        ({"pressures": (float("nan"),)}, "finite"),
        ({"cycles": 0}, "cycles must be a whole number >= 1, got 0"),
        ({"stroke": 0.0}, "stroke must be a number > 0 and finite, got 0"),
        ({"rate": float("inf")}, "rate must be a number > 0 and finite, got inf"),
        ({"settle": -1.0}, "settle must be a number >= 0 and finite, got -1"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(change: dict, message: str) -> None:
    fields = {"pressures": (1e5,), "cycles": 1, "stroke": 0.05, "rate": 0.001, **change}
    with pytest.raises(InputError, match=message):
        Isobaric(**fields)


FILE = """
[plan]
pressures_psi = [20, 40.5]
cycles = 3
stroke_in = 2
rate_in_per_s = 0.04
settle_s = 10
photograph_every_s = 5

[rig]
circuit = "water"
pressure_limit_psi = 110
proportional_counts_per_psi = 0
integral_counts_per_psi_s = 5
integral_limits_counts = [-100, 120]
jump_limit_bar = 3
calibration = "rig.toml"
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "plan.toml"
    path.write_text(text)
    return path


def test_a_file_is_read_in_its_units(tmp_path: Path) -> None:
    file = read_plan(written(tmp_path, FILE))
    assert file.plan.pressures == pytest.approx((20 * PSI, 40.5 * PSI))
    assert (file.plan.stroke, file.plan.rate) == pytest.approx((0.0508, 0.001016))
    assert (file.plan.cycles, file.plan.settle, file.plan.photograph_every) == (3, 10, 5)
    assert file.pressure_limit == pytest.approx(110 * PSI)
    assert file.control.integral * PSI == pytest.approx(5)
    assert file.control.integral_limits == (-100, 120)
    assert file.jump_limit == pytest.approx(3e5)
    assert file.calibration == tmp_path / "rig.toml"
    assert any("relief valve" in line for line in PRECONDITIONS[file.circuit])


def test_a_file_without_a_jump_limit_has_the_device_s(tmp_path: Path) -> None:
    text = FILE.replace("jump_limit_bar = 3\n", "")
    assert read_plan(written(tmp_path, text)).jump_limit == pytest.approx(15 * PSI)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "pressure_limit_psi = 110\n",
            "",
            "pressure_limit_<unit> is missing: .* as pressure_limit_Pa",
        ),
        ("pressure_limit_psi", "pressure_limit", "must end with a unit of pressure"),
        ("pressures_psi", "pressures_psia", "must end with a unit of pressure"),
        ("stroke_in", "stroke", "must end with a unit of length"),
        ("stroke_in = 2\n", "", "stroke_<unit> is missing"),
        ("jump_limit_bar", "jump_limit", "must end with a unit of pressure"),
        ("jump_limit_bar = 3", "jump_limit_bar = -3", "jump_limit_bar must be a number >= 0"),
        ("cycles = 3", "cycles = 2.5", "cycles must be a whole number >= 1, got 2.5"),
        ("[20, 40.5]", '["a"]', "pressures_psi must be one pressure at least, each a number >= 0"),
        ("settle_s", "settel_s", r"\[plan\]: unknown key 'settel_s'; known are .*settle_<unit>"),
        ("circuit", "circiut", r"\[rig\]: unknown key 'circiut'; circuit is missing: air or water"),
        ('"water"', '"oil"', "circuit must be air or water, got 'oil'"),
        ("[-100, 120]", "[0, 300]", "integral_limits_counts must be"),
        ("integral_counts_per_psi_s = 5\n", "", "integral_counts_per_psi_s is missing"),
        ("[rig]", "[rigg]", "the tables"),
        ("[plan]", "[plan", "cannot read the plan"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in FILE
    with pytest.raises(InputError, match=message):
        read_plan(written(tmp_path, FILE.replace(old, new)))
