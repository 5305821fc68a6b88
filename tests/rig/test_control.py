"""A rig in virtual time: it holds pressures, records everything, and is vented on every way out."""

# ruff: noqa: PT012 -- the way out of a with block is what is tested

from pathlib import Path

import numpy as np
import pytest
from benches import GAINS, LIMIT, PSI, journal_of, opened, vented

from famjax.app.isobaric import convert, table
from famjax.plant import HydraulicCircuit, LinearMcKibben
from rig.calibration import Calibration, FeedForward, Sensor, read_calibration
from rig.control import Control, Rig, stored_settings
from rig.device import firmware_folder
from rig.errors import RigError, RigFault
from rig.execution import calibrate_feed_forward, run
from rig.journal import audit, read_journal, summary
from rig.link import VirtualLink
from rig.plan import Isobaric, next_block
from rig.protocol import PRESSURE_UNIT, RUN, frame
from rig.simulation import SimulatedRig, load_cell

PLAN = Isobaric((20 * PSI, 40 * PSI), cycles=1, stroke=0.01, rate=0.002, settle=3.0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small isobaric test with its machine, its strokes much faster than those of a real one."""
    path, sim = tmp_path_factory.mktemp("rig") / "run.fam", SimulatedRig(clock_rate=0.002)
    with journal_of(path, sim) as journal, opened(sim, journal) as rig:
        run(rig, PLAN, machine=sim.machine)
    assert vented(sim)
    return path


def test_a_plan_holds_its_pressures_and_its_summary_says_so(recorded: Path) -> None:
    columns, rows = table(read_journal(recorded)), summary(read_journal(recorded))
    for block, (pressure, row) in enumerate(zip(PLAN.pressures, rows, strict=True)):
        held = (columns["block"] == block) & (columns["state"] == RUN)
        settled = held & (columns["time_s"] > columns["time_s"][held][0] + PLAN.settle)
        assert columns["pressure_Pa"][settled].mean() == pytest.approx(pressure, abs=0.5 * PSI)
        unit = PSI / PRESSURE_UNIT  # the device's step
        assert columns["set_pressure_Pa"][settled] == pytest.approx(pressure, abs=unit)
        assert settled.sum() > 990
        assert row["mean_Pa"] == pytest.approx(pressure, abs=0.5 * PSI)
        error = columns["pressure_Pa"][settled] - pressure
        assert row["rms_error_Pa"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.1)
        assert (row["block"], row["strokes"], row["trips"], row["completed"]) == (block, 1, 0, True)


def test_an_audit_recomputes_every_record(recorded: Path) -> None:
    found = audit(read_journal(recorded))
    assert found.sound
    assert found.checked == found.equal == found.records
    assert found.unchecked == found.lost == found.torn == 0
    assert found.ended == "complete"


@pytest.mark.parametrize(("column", "by"), [(4, 100), (5, 100), (7, 1), (8, 1)])
def test_an_audit_sees_an_edited_figure(
    recorded: Path, tmp_path: Path, column: int, by: int
) -> None:
    """The sum and the count of the pressure, output and integral, each with its CRC made right."""
    lines = recorded.read_bytes().split(b"\n")
    at = next(i for i, line in enumerate(lines) if line.startswith(b"T,0,2900,"))
    fields = lines[at][:-5].decode().split(",")
    fields[column] = str(int(fields[column]) + by)
    lines[at] = frame(",".join(fields))[:-1]
    (tmp_path / "edited.fam").write_bytes(b"\n".join(lines))
    found = audit(read_journal(tmp_path / "edited.fam"))
    assert found.checked - found.equal in {1, 2}  # the next one follows from the integral
    assert found.first_wrong == (0, int(fields[2]))


def test_a_journal_that_was_cut_off_is_not_sound_until_it_is_resumed(
    recorded: Path, tmp_path: Path
) -> None:
    cut, sim = tmp_path / "cut.fam", SimulatedRig(seed=1)
    cut.write_bytes(recorded.read_bytes()[:90_000])  # in the middle of a line
    assert not audit(read_journal(cut)).sound
    with journal_of(cut, sim, append=True) as journal, opened(sim, journal) as rig:
        run(rig, PLAN, first_block=next_block(read_journal(cut).notes))
    found = audit(read_journal(cut))
    assert (found.faults, found.ended) == ([], "complete")


def test_columns_have_units_and_one_row_for_each_record(recorded: Path, tmp_path: Path) -> None:
    record = read_journal(recorded)
    columns = table(record)
    assert {values.shape for values in columns.values()} == {(len(record.rows),)}
    assert (np.diff(columns["time_s"]) > 0).all()
    back = np.genfromtxt(convert(recorded, tmp_path / "run.csv"), delimiter=",", names=True)
    for name, values in columns.items():
        np.testing.assert_array_equal(back[name], values)
    # The simulated clock gains 2000 ppm; a port sends at once what a tick of 2 ms carries, and the
    # link looks every 4 ms.
    assert np.abs(columns["time_s"] - columns["device_time_s"] / 1.002).max() < 4e-3


def test_parts_of_a_recording_go_on_where_they_were_and_may_have_other_clocks(
    tmp_path: Path,
) -> None:
    """Resumed after the computer was started again: the second part's time begins anew."""
    path, plan = tmp_path / "two.fam", Isobaric((20 * PSI, 40 * PSI), 1, 0.01, 0.01, settle=1.0)
    first, second = SimulatedRig(), SimulatedRig()
    first.advance(500.0)
    first.read()  # nobody was listening
    with (
        journal_of(path, first) as journal,
        pytest.raises(KeyboardInterrupt),
        opened(first, journal) as rig,
    ):
        run(rig, Isobaric(plan.pressures[:1], 1, 0.01, 0.01, settle=1.0))
        raise KeyboardInterrupt
    assert vented(first)
    with journal_of(path, second, append=True) as journal, opened(second, journal) as rig:
        run(rig, plan, first_block=next_block(read_journal(path).notes))
    found = read_journal(path)
    columns = table(found)
    assert found.epoch_parts == (0, 1)
    assert [note["block"] for note in found.notes_of("done")] == [0, 1]
    assert [n["reason"] for n in found.notes_of("end")] == ["KeyboardInterrupt: ", "complete"]
    assert audit(found).sound
    for block, start in ((0, 500.0), (1, 0.0)):
        times = columns["time_s"][columns["block"] == block]
        assert start < times.min() < times.max() < start + 12
        assert np.ptp(times) == pytest.approx(3.0, abs=0.05)


def test_photographs_are_triggered_and_noted(tmp_path: Path) -> None:
    taken: list[str] = []
    path, sim = tmp_path / "photo.fam", SimulatedRig()
    plan = Isobaric((20 * PSI,), 1, 0.005, 0.001, settle=1.0, photograph_every=2.5)
    with journal_of(path, sim) as journal, opened(sim, journal, camera=taken.append) as rig:
        run(rig, plan)
    notes = read_journal(path).notes_of("trigger")
    assert taken == [note["name"] for note in notes] == [f"block00-{k:05d}" for k in range(5)]
    np.testing.assert_allclose(np.diff([note["at"] for note in notes]), 2.5, atol=0.01)
    ticks = np.diff([note["tick"] for note in notes]) / 500
    np.testing.assert_allclose(ticks, 2.5, atol=0.02)


FLAT = FeedForward((128.0, 0, 0, 0), pressure_range=(0.0, 30 * PSI))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pressure_limit": None}, "under a finite pressure limit > 0, got None"),
        ({"pressure_limit": 0.0}, "pressure limit > 0, got 0"),
        ({"pressure_limit": float("nan")}, "finite pressure limit > 0"),
        ({"pressure_limit": 300 * PSI, "unit": "psi"}, "limit of 300 psi is 1330 counts"),
        ({"jump_limit": 0.5 * PSI, "unit": "psi"}, "limit of 0.5 psi is 2 counts.*5 to 1023"),
        ({"jump_limit": float("nan")}, "0 counts"),
        ({"stall": 90.0}, "stall must be 0.5 to 30, got 90"),
        ({"frozen_output": 0}, "frozen_output must be 1 to 255"),
        (
            {"calibration": Calibration(Sensor(300.0, -50.0), Sensor(1.0, 0.0))},
            "zero of 0 to 1023.9",
        ),
    ],
)
def test_settings_that_cannot_be_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(RigError, match=message):
        opened(SimulatedRig(), **changes)


def test_a_plan_above_the_limit_or_the_feed_forward_is_not_started() -> None:
    sim = SimulatedRig()
    with opened(sim, unit="psi") as rig:
        with pytest.raises(RigError, match=r"the plan sets 110 psi, the limit is 110 psi"):
            run(rig, Isobaric((20 * PSI, LIMIT), 1, 0.01, 0.002))
        rig.calibration = Calibration(rig.calibration.pressure, rig.calibration.force, FLAT)
        with pytest.raises(
            RigError, match=r"feed-forward is known from 0 psi to 30 psi, not at 40"
        ):
            run(rig, PLAN)
        with pytest.raises(RigError, match=r"below the limit of 110 psi, got 110 psi"):
            rig.set_pressure(LIMIT)
        rig.wait(1.0)
        assert sim.pressure < PSI


def test_the_device_reports_what_its_twin_stores_of_the_settings(tmp_path: Path) -> None:
    sim = SimulatedRig()
    with (
        journal_of(tmp_path / "run.fam", sim) as journal,
        opened(sim, journal, jump_limit=40 * PSI, frozen_output=6, frozen=0.5, stall=2.0) as rig,
    ):
        settings = rig.link.session.settings
        assert settings is not None
        wanted = stored_settings(rig.settings.commands(rig.calibration))
        sensor = sim.calibration().pressure
        assert sensor.value(5 * settings.trip) <= LIMIT < sensor.value(5 * (settings.trip + 1))
    assert settings.jump == wanted["jump"] == round(40 / (200 / (4.0 / 5 * 1024)))
    assert (settings.frozen, settings.frozen_ticks, settings.stall) == (6, 250, 1000)
    assert (settings.silence, settings.ticks_per_record) == (500, 5)
    record = read_journal(tmp_path / "run.fam")
    (note,) = record.notes_of("rig")
    assert (note["frozen_output_counts"], note["unseen"]) == (6, [])


SMALL = {"rest_length": 0.1, "thread_length": 0.106, "turns": 2.35, "solid_volume": 0.6e-6,
         "bladder_stiffness": 200.0}  # a muscle of 3/16 in and 1.2 ml  # fmt: skip


def test_a_small_muscle_trips_on_a_large_step_until_the_plan_allows_it() -> None:
    def step(**limit: float) -> float:
        sim = SimulatedRig(muscle=LinearMcKibben(**SMALL), force_sensor=load_cell(500.0))
        with opened(sim, control=Control.per_psi(1, 2), **limit) as rig:
            rig.set_pressure(80 * PSI)
            rig.wait(5.0)
            return sim.pressure

    with pytest.raises(RigFault, match=r"TRIP by itself: jump.*raise jump_limit_<unit>"):
        step()
    assert step(jump_limit=60 * PSI) == pytest.approx(80 * PSI, abs=PSI)


def test_sync_raises_the_pin_for_whole_records(tmp_path: Path) -> None:
    sim = SimulatedRig(baud=500000)
    with journal_of(tmp_path / "run.fam", sim) as journal, opened(sim, journal) as rig:
        rig.sync(0.25)
        rig.wait(1.0)
        with pytest.raises(RigError, match=r"refuses 'sync 0'"):
            rig.sync(0.001)
    record = read_journal(tmp_path / "run.fam")
    (note,) = record.notes_of("sync")
    high = record.column("seq")[record.column("flags") & 4 > 0]
    assert high.tolist() == list(range(note["seq"], note["seq"] + 25))


@pytest.mark.parametrize("error", [ValueError("x"), KeyboardInterrupt(), SystemExit(1)])
def test_whatever_ends_a_test_vents(error: BaseException) -> None:
    sim = SimulatedRig()
    with pytest.raises(type(error)), opened(sim) as rig:
        rig.set_pressure(40 * PSI)
        rig.wait(3.0)
        assert sim.pressure > 35 * PSI
        raise error
    assert vented(sim)
    sim.advance(1.0)
    assert sim.pressure < 5 * PSI


def test_a_plan_that_hangs_vents_by_itself() -> None:
    sim = SimulatedRig()
    with opened(sim) as rig:
        rig.set_pressure(40 * PSI)
        rig.wait(3.0)
        rig.link.sleep(5.0 + 1.0 + 0.25)  # nobody supervises: heartbeats end after 5 s
        assert vented(sim)
        with pytest.raises(RigFault, match=r"went to SAFE by itself: silence"):
            rig.check()


def test_a_device_that_does_not_answer_is_never_left_with_heartbeats() -> None:
    sim = SimulatedRig()
    with (
        pytest.raises(RigFault, match=r"did not confirm that it stopped.*look at the pressure"),
        opened(sim) as rig,
    ):
        rig.set_pressure(40 * PSI)
        rig.wait(2.0)
        sim.to_host.cut = sim.to_device.cut = True
    assert vented(sim)


def test_the_calibration_in_the_readme_holds_a_pressure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its code as it stands, on a simulated rig in the place of the port."""
    text = (firmware_folder() / "README.md").read_text(encoding="utf-8")
    code = text.partition("## Calibrate")[2].partition("```python\n")[2].partition("```")[0]
    sim = SimulatedRig(HydraulicCircuit())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rig.Link", lambda opener: VirtualLink(sim))
    exec(compile(code, "README.md", "exec"), {})
    calibration = read_calibration(tmp_path / "calibration.toml")
    # Counts were rounded to whole ones, 0.05 psi; a cubic meets the needle's square root to 2 counts.
    assert float(calibration.pressure.value(1328.7)) == pytest.approx(40 * PSI, abs=0.1 * PSI)
    for psi in (20, 80):
        steady = 255 * sim.circuit.steady_signal(psi * PSI)
        assert calibration.feed_forward.output(psi * PSI) == pytest.approx(steady, abs=2.0)


def test_the_feed_forward_of_a_pump_is_found_by_stepping_it() -> None:
    circuit = HydraulicCircuit()
    sim = SimulatedRig(circuit)
    true = sim.calibration().feed_forward
    outputs = [int(255 * circuit.steady_signal(p * PSI)) for p in (8, 20, 35, 50, 65, 80, 95)]
    with Rig(VirtualLink(sim), sim.calibration(), pressure_limit=LIMIT, control=GAINS) as rig:
        found = calibrate_feed_forward(rig, [*outputs, *outputs[::-1]], settle=2.5, average=1.0)
    assert vented(sim)
    for pressure in (10, 30, 60, 90):
        # the pump moves in steps of one count, and the cubic is not its law
        assert found.output(pressure * PSI) == pytest.approx(true.output(pressure * PSI), abs=3)
    assert found.scatter < 3
