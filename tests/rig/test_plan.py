"""Plans: timed, resumed, read from files with units, and as the documents print them."""

import dataclasses
import re

import pytest
from benches import PSI

from famjax.boundary.errors import InputError
from rig import cli, read_plan
from rig.cli import describe
from rig.execution import record_test
from rig.journal import audit, read_journal
from rig.link import VirtualLink
from rig.plan import Isobaric, PlanFile
from rig.simulation import CIRCUITS, SimulatedRig

PLAN = Isobaric((1e5, 3e5, 2e5), cycles=2, stroke=0.05, rate=0.001, settle=4.0)


def test_duration_is_settling_and_strokes_and_a_plan_is_listed_with_its_times():
    assert PLAN.duration() == pytest.approx(3 * (4 + 2 * 2 * 0.05 / 0.001))
    assert (PLAN.duration(2), PLAN.duration(3)) == (pytest.approx(204), 0)
    lines = describe(PlanFile(PLAN, "air", 4e5, None, unit="bar"))
    assert len(lines) == 3
    assert lines[1].startswith("   204.0 s  block 1: 3 bar, settle 4 s, 2 strokes of 50 mm at 1")


FILE = """
[plan]
pressures_psi = [20, 40.5]
cycles = 3
stroke_in = 2
rate_in_per_s = 0.04
settle_s = 10

[rig]
circuit = "water"
pressure_limit_psi = 110
proportional_counts_per_psi = 0
integral_counts_per_psi_s = 5
integral_limits_counts = [-100, 120]
jump_limit_bar = 3
frozen_ms = 500
calibration = "rig.toml"
"""


def read(folder, text):
    path = folder / "plan.toml"
    path.write_text(text, encoding="utf-8")
    return read_plan(path)


def test_a_file_is_read_in_its_units(tmp_path):
    file = read(tmp_path, FILE)
    assert file.plan.pressures == pytest.approx((20 * PSI, 40.5 * PSI))
    assert (file.plan.stroke, file.plan.rate) == pytest.approx((0.0508, 0.001016))
    assert (file.plan.cycles, file.plan.settle) == (3, 10)
    assert file.pressure_limit == pytest.approx(110 * PSI)
    assert (file.control.integral * PSI, file.unit) == (pytest.approx(5), "psi")
    assert file.control.integral_limits == (-100, 120)
    assert (file.settings.jump_limit, file.settings.frozen) == pytest.approx((3e5, 0.5))
    assert file.calibration == tmp_path / "rig.toml"
    short = read(tmp_path, FILE.replace("jump_limit_bar = 3\n", ""))
    assert short.settings.jump_limit == pytest.approx(15 * PSI)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pressure_limit_psi = 110\n", "", "pressure_limit_<Pa.kPa.MPa.bar.psi> is missing: a num"),
        ("pressures_psi", "pressures_psia", "unknown key .*; pressures_<Pa.kPa.MPa.bar.psi> is"),
        ("stroke_in", "stroke", "unknown key .*; stroke_<m.cm.mm.um.in> is missing"),
        ("stroke_in = 2", "stroke_in = 0", "must be a number > 0 and finite, got 0"),
        ("settle_s = 10", "settle_s = -1", "must be a number >= 0 and finite, got -1"),
        ("jump_limit_bar = 3", "jump_limit_bar = -3", "jump_limit_bar must be a number >= 0"),
        ("cycles = 3", "cycles = 2.5", "cycles must be a whole number >= 1, got 2.5"),
        ("[20, 40.5]", '["a"]', "_psi must be at least one pressure, each a finite number >= 0"),
        ("[20, 40.5]", "[]", "at least one pressure"),
        ("[20, 40.5]", "[20,5, 40,5]", r"pressures_psi = \[20,5, 40,5\] seems to contain decimal"),
        ("[20, 40.5]", "[20,5]", "decimal commas"),
        (
            "settle_s = 10",
            "settle_s = 2\nrise_s = 3",
            "rise_s must not exceed settle_s \\(2\\), got 3",
        ),
        ("settle_s = 10", "settle_s = 2,5", "cannot read the plan"),
        ("settle_s", "settel_s", r"\[plan\]: unknown key 'settel_s'; valid .*settle_<s.ms.min>"),
        ("circuit", "circiut", r"\[rig\]: unknown key 'circiut'; circuit is missing: air or water"),
        ('"water"', '"oil"', "circuit must be air or water, got 'oil'"),
        ("[-100, 120]", "[0, 300]", "integral_limits_counts must be"),
        ("[rig]", "[rigg]", "the tables"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path, old, new, message):
    assert old in FILE
    with pytest.raises(InputError, match=message):
        read(tmp_path, FILE.replace(old, new))


HELP = (cli.__doc__ or "").partition("```toml\n")[2].partition("```")[0]
PRINTED = (read_plan.__doc__ or "").partition("[plan]\n")[2].partition("[rig] may")[0]
WATER = HELP.replace("psi = 4", "psi = 3").replace("_s = 2", "_s = 8").replace('"air"', '"water"')
PLANS = {"help": HELP, "help, water": WATER, "read_plan": f"[plan]\n{PRINTED}"}


@pytest.mark.parametrize("name", PLANS)
def test_a_printed_plan_is_carried_out(name, path):
    """With its rate, gains, limits and guards, shorter; those of documents run with their pages."""
    test = read(path.parent, PLANS[name])
    quick = dataclasses.replace(test.plan, cycles=1, stroke=0.01, settle=4.0)
    sim = SimulatedRig(CIRCUITS[test.circuit]())
    test = dataclasses.replace(test, plan=quick)
    record_test(test, VirtualLink(sim), sim.calibration(), path, machine=sim.machine)
    assert audit(read_journal(path)).sound
    rows = path.with_suffix(".csv").read_text().splitlines()
    assert rows[0].split(",")[:4] == ["block", "set_pressure_Pa", "mean_Pa", "rms_error_Pa"]
    assert [row.split(",")[4:] for row in rows[1:]] == [["1", "0", "True"]] * len(quick.pressures)


def test_all_options_of_the_help_are_options(tmp_path):
    everything = re.sub(r"^# (\w+ = )", r"\1", HELP, flags=re.MULTILINE)
    assert everything.count("\n# ") == 0 < HELP.count("\n# ")
    short, full = read(tmp_path, HELP), read(tmp_path, everything)
    assert (full.settings, full.control) == (short.settings, short.control)
