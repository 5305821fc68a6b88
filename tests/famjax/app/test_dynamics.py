"""Commands of dynamics: plans simulated, rigs tuned, whole tests through files against what is true."""

import dataclasses
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from famjax.app.dynamics import feed_forward
from famjax.app.simulation import SimulatedTest, simulate
from famjax.app.tuning import step_test, tuned_text
from famjax.boundary.errors import InputError
from famjax.control.tuning import Duty, Gains, drawn_circuits, expect, tune
from famjax.plant import DahlFriction, HydraulicCircuit, LinearMcKibben, Plant, PneumaticCircuit
from famjax.units import INCH, LBF, PSI
from fitting import load_fit, read_csv
from rig import audit, read_journal
from rig.control import Control
from rig.plan import Isobaric, PlanFile, read_plan
from rig.protocol import Sample, Splitter, parse
from rig.simulation import ByteChannel, SimulatedRig

LIFT = """
[circuit]
fluid = "air"
supply_kPa = 700
[load]
length_mm = 285
mass_kg = 20
damping_N_s_per_m = 200
[controller]
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
[[step]]
duration_s = 1.5
set_pressure_kPa = 300
[[step]]
duration_s = 0.5
set_pressure_kPa = 200
"""


@pytest.mark.slow
def test_a_bundled_muscle_lifts_a_mass(said, tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text(LIFT)
    told = said("simulate", "DMSP-20", plan, "-o", tmp_path / "out", "--json")
    first, second = json.loads(told)["steps"]
    assert first["pressure_Pa"] == pytest.approx(300e3, rel=0.06)
    assert first["force_N"] == pytest.approx(20 * 9.80665, rel=0.02)
    assert second["length_m"] > first["length_m"]
    table = np.genfromtxt(tmp_path / "out/simulation.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time_s", "pressure_kPa", "length_mm", "force_N")
    assert table["time_s"] == pytest.approx(0.01 * np.arange(1, 201))
    assert (tmp_path / "out/simulation.svg").stat().st_size > 5000


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"air"', '"oil"', "fluid must be 'air' or 'water', got 'oil'"),
        ("supply_kPa = 700", "supply_kPa = -7", "supply must be finite and at least 0 Pa"),
        ("[load]", "[lode]", "unknown table 'lode'"),
        (
            "set_pressure_kPa = 200",
            "signal = 0.5",
            "step must have a signal, or every step must have a",
        ),
        ("[controller]", "[friction]", "proportional_counts_per_psi is missing"),
        ("set_pressure_kPa = 200", "set_pressure_kPa = 200\nvalve = 1", "[[step]] 2: unknown key"),
    ],
)
def test_a_plan_that_cannot_be_is_refused_in_a_sentence(old, new, words, refused, tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text(LIFT.replace(old, new))
    refused(words, "simulate", "DMSP-20", plan, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


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
def test_tuned_gains_hold_unseen_plants_better(circuit):
    some, forwards = plants(circuit, 3)
    found = tune(some, forwards, DUTY, seed=2)
    others, own = plants(circuit, 6)
    before = expect(others[3:], own[3:], Gains.per_psi(3.0, 8.0, 1000.0), DUTY, seed=5)
    after = expect(others[3:], own[3:], found, DUTY, seed=5)
    assert after.rms.max() < 0.7 * before.rms.max()
    assert (after.overshoot / np.abs(np.diff([0.0, *DUTY.pressures]))).max() < 0.1
    assert after.highest.max() < DUTY.limit


@pytest.mark.parametrize(
    "change", [{"pressures": ()}, {"pressures": (90 * PSI,)}, {"rate": 0.0}, {"settle": 0.5}]
)
def test_a_duty_that_cannot_be_done_is_refused(change):
    with pytest.raises(InputError, match="below the limit, stroke and rate above 0"):
        dataclasses.replace(DUTY, **change)


def test_the_text_of_a_plan_keeps_all_but_its_gains(tmp_path):
    rounded = {"proportional_counts_per_psi": 12.35, "integral_counts_per_psi_s": 40.0}
    gains = rounded | {"proportional_counts_per_psi": 12.345678, "rise_s": 1.25}
    found = tuned_text(PLAN, gains)
    before, after = tomllib.loads(PLAN), tomllib.loads(found)
    before["plan"]["rise_s"] = 1.25
    before["rig"] |= rounded
    assert after == before
    assert "# of a colleague" in found
    assert tuned_text(found, gains) == found
    path = tmp_path / "plan.toml"
    path.write_text(found)
    assert read_plan(path).plan.rise == 1.25


def test_a_step_test_is_small_and_below_its_own_limit(tmp_path):
    path = tmp_path / "plan.toml"
    for text, low, high in ((PLAN, 20, 40), (PLAN.replace("20, 40, 60", "30"), 18, 30)):
        path.write_text(text)
        test = step_test(read_plan(path))
        assert sorted(set(test.plan.pressures)) == pytest.approx([low * PSI, high * PSI])
        assert test.pressure_limit == pytest.approx((high + 15) * PSI)
        assert test.plan.stroke < 2e-4


@pytest.mark.slow
@pytest.mark.parametrize("fluid", ["air", "water"])
def test_a_rig_is_tuned_from_its_step_test(said, refused, tmp_path, fluid):
    plan, journal = tmp_path / "plan.toml", tmp_path / "step" / "test.fam"
    plan.write_text(PLAN.replace("water", fluid))
    said("rig", "step", plan, "--simulate", "-o", journal.parent)
    asked = ("rig", "tune", journal, "--plan", plan, "-o", tmp_path / "tuned.toml")
    assert "written:" in said(*asked)
    assert read_plan(tmp_path / "tuned.toml").plan.rise > 0
    other = tmp_path / "other.toml"
    other.write_text(PLAN.replace("water", "air" if fluid == "water" else "water"))
    refused("exists", *asked)
    refused("use either a journal", *asked, "--simulate")
    new = "--plan", other, "-o", tmp_path / "new.toml"
    refused("but the plan describes", *asked[:3], *new)


GAINS = {"air": Control.per_psi(4, 2), "water": Control.per_psi(0, 5)}  # table 3.2, 7/8 in


def test_the_bytes_do_not_depend_on_the_steps():
    streams = []
    for step in (0.001, 0.004, 0.1):
        rig = SimulatedRig(to_host=ByteChannel(baud=115200), clock_rate=-2e-3, seed=5)
        for command in ("trip 600", "gain 4 2", "set 20 128", "run"):
            rig.write(command.encode() + b"\n")
            rig.advance(0.1)
        for _ in range(round(0.6 / step)):
            rig.advance(step)
        rig.advance(0.6 + 0.4 - rig.now + 1e-9)
        streams.append(rig.read())
    assert streams[0] == streams[1] == streams[2]
    assert len(streams[0]) > 4000


@pytest.mark.parametrize("rate", [-2e-3, 0.0, 3e-3])
def test_the_device_counts_by_its_own_clock(rate):
    rig = SimulatedRig(clock_rate=rate)
    rig.advance(20.0)
    *_, last = (m for m in map(parse, Splitter().feed(rig.read())) if isinstance(m, Sample))
    assert last.tick * 2e-3 == pytest.approx(20.0 * (1 + rate), abs=0.02)  # a record and its line


def whole_test(folder: Path, fluid: str, pressures: tuple[float, ...], **options) -> SimulatedTest:
    plan = Isobaric(
        tuple(p * PSI for p in pressures), cycles=1, stroke=options.pop("stroke", 3.4 * INCH),
        rate=options.pop("rate", 0.04 * INCH), settle=5.0,
    )  # fmt: skip
    return simulate(PlanFile(plan, fluid, 115 * PSI, GAINS[fluid]), folder, **options)


@pytest.mark.slow
def test_a_whole_test_finds_the_muscle_that_was_simulated(tmp_path):
    muscle = LinearMcKibben()
    air = whole_test(tmp_path, "air", (30, 70), rate=0.06 * INCH, seed=3)
    for bar in air.analysis.characterisation.isobars:
        truth = np.asarray(muscle.force(bar.length, bar.set_pressure))
        inner = slice(8, -3)  # beyond the pressure's dip at the turn
        # Friction is 2 % to either side; 0.3 psi of pressure are 3 lbf.
        assert np.abs(bar.force - truth)[inner].max() < 4 * LBF
        half = (bar.lengthening - bar.shortening)[inner] / 2
        assert np.abs(half - 0.02 * truth[inner]).max() < 4 * LBF
        blocked = float(muscle.blocked_force(bar.set_pressure))
        assert bar.blocked_force == pytest.approx(blocked, rel=0.03)
        free = float(muscle.free_contraction(bar.set_pressure))
        assert bar.free_contraction == pytest.approx(free, abs=0.003)
    # Its journal is sound, and its dataset is read by a fit.
    found = audit(read_journal(air.paths[0]))
    assert found.sound
    assert found.checked == found.equal > 10_000
    assert found.lost == 0
    data = read_csv(air.paths[2])
    assert data.specimen.rest_length == LinearMcKibben().rest_length
    assert data.max_force == pytest.approx(720 * LBF, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("fluid", ["air", "water"])
def test_published_gains_hold_the_published_pressure(fluid, tmp_path):
    """Chapter 3: 0.02 in/s; 20 and 100 psi. Mean within 0.1 psi, deviation 0.15 to 0.45 psi."""
    done = whole_test(tmp_path, fluid, (20, 100), rate=0.02 * INCH, seed=11)
    for bar in done.analysis.characterisation.isobars:
        assert abs(bar.pressure - bar.set_pressure) < 0.1 * PSI
        assert 0.15 * PSI < bar.pressure_std < 0.45 * PSI


STAIRS = """[plan]
pressures_kPa = [150, 250, 350, 450, 550]
cycles = 3
stroke_mm = 55
rate_mm_per_s = 1.5
settle_s = 5
[rig]
circuit = "air"
pressure_limit_psi = 110
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
"""


@pytest.mark.slow
def test_a_fit_of_the_dataset_returns_the_fit_that_was_simulated(said, tmp_path):
    """Within three of its own standard errors; the forces within 1.6 N of the truth's."""
    plan, folders = tmp_path / "plan.toml", (tmp_path / "truth", tmp_path / "found")
    plan.write_text(STAIRS)
    simulated = "--fit", folders[0] / "fit.json", "--seed", 0, "--output", folders[1]
    law = "--law", "polynomial", "--order", 2, "--output"
    said("fit", "DMSP-20-300", *law, folders[0])
    said("rig", "simulate", plan, *simulated)
    said("fit", folders[1] / "dataset.csv", *law, folders[1])
    truth, found = (json.loads((one / "fit.json").read_text()) for one in folders)
    truth, found = (one["parameters"] | one["derived"] for one in (truth, found))
    for name in ("thread_length", "deadband_pressure", "E_1", "E_2"):
        error = found[name]["value"] - truth[name]["value"]
        assert abs(error) < 3 * found[name]["stderr"], name
    data = read_csv(folders[1] / "dataset.csv")
    assert np.unique(data.pressures.level).size == 5
    muscles = [load_fit(folder / "fit.json").muscle for folder in folders]
    one, other = (muscle.force(data.length, data.pressure) for muscle in muscles)
    assert np.sqrt(np.mean(np.square(one - other))) < 1.6
