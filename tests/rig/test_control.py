"""A rig in virtual time: holds pressures, records everything, is vented however it ends, and attended."""

# ruff: noqa: PT012 -- the way out of a with block is what is tested

import contextlib
import dataclasses
import os
import threading
from pathlib import Path

import numpy as np
import pytest
from benches import LIMIT, PSI, Wired, cable, journal_of, opened, recorded, vented
from faulty_channel import FaultyChannel

from famjax.app.isobaric import analyse, convert, table
from famjax.plant import HydraulicCircuit
from fitting.records import read_machine_log
from rig.calibration import Calibration, FeedForward, Sensor, read_calibration
from rig.control import Control, stored_settings
from rig.device import Device, firmware_folder
from rig.errors import RigError, RigFault
from rig.execution import Attendant, Situation, run
from rig.journal import audit, read_journal, summary
from rig.link import VirtualLink
from rig.plan import Isobaric
from rig.protocol import PRESSURE_UNIT, RUN, SAFE, frame
from rig.simulation import ByteChannel, SimulatedRig

PLAN = Isobaric((20 * PSI, 40 * PSI), cycles=1, stroke=0.01, rate=0.002, settle=3.0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A small isobaric test with its machine, its strokes much faster than those of a real one."""
    path, sim = tmp_path_factory.mktemp("rig") / "run.fam", SimulatedRig(clock_rate=0.002)
    with recorded(path, sim) as rig:
        run(rig, PLAN, machine=sim.machine)
    return path


def test_a_plan_holds_its_pressures_and_summary_and_columns_say_so(whole, tmp_path):
    """The columns have units, and one row for each record."""
    record = read_journal(whole)
    found, columns, rows = audit(record), table(record), summary(record)
    assert found.faults == []
    assert found.checked == found.equal == found.records
    assert (found.unchecked, found.lost, found.torn, found.ended) == (0, 0, 0, "complete")
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
    assert {values.shape for values in columns.values()} == {(len(record.rows),)}
    assert (np.diff(columns["time_s"]) > 0).all()
    back = np.genfromtxt(convert(whole, tmp_path / "run.csv"), delimiter=",", names=True)
    for name, values in columns.items():
        np.testing.assert_array_equal(back[name], values)
    # The simulated clock gains 2000 ppm; a port sends at once what a tick of 2 ms carries, and the
    # link looks every 4 ms.
    assert np.abs(columns["time_s"] - columns["device_time_s"] / 1.002).max() < 4e-3


@pytest.mark.parametrize(("column", "by"), [(4, 100), (5, 100), (7, 1), (8, 1)])
def test_an_audit_sees_an_edited_figure(whole, path, column, by):
    """The sum and the count of the pressure, output and integral, each with its CRC made right."""
    lines = whole.read_bytes().split(b"\n")
    at = next(i for i, line in enumerate(lines) if line.startswith(b"T,0,2900,"))
    fields = lines[at][:-5].decode().split(",")
    fields[column] = str(int(fields[column]) + by)
    lines[at] = frame(",".join(fields))[:-1]
    path.write_bytes(b"\n".join(lines))
    found = audit(read_journal(path))
    assert found.checked - found.equal in {1, 2}  # the next one follows from the integral
    assert found.first_wrong == (0, int(fields[2]))
    wrong = f"records do not follow the control law, starting with record {fields[2]}"
    assert wrong in found.faults[0]


def test_a_recording_that_was_cut_off_is_resumed_and_its_clock_may_begin_anew(whole, path):
    """Resumed after the computer was started again."""
    sim = SimulatedRig(seed=1)
    path.write_bytes(whole.read_bytes()[:90_000])  # in the middle of a line
    assert not audit(read_journal(path)).sound
    before = table(read_journal(path))["time_s"]
    with journal_of(path, sim, append=True) as journal, opened(sim, journal) as rig:
        run(rig, PLAN)
    found = read_journal(path)
    assert (audit(found).faults, audit(found).ended) == ([], "complete")
    assert found.epoch_parts == (0, 1)
    assert [note["block"] for note in found.notes_of("done")] == [0, 1]
    times = table(found)["time_s"]
    np.testing.assert_allclose(times[: before.size], before, atol=1e-3)
    second = times[found.epoch == 1]
    assert 0 <= second[0] < 2
    assert np.ptp(second) == pytest.approx(sim.now, abs=1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pressure_limit": None}, "the pressure limit must be finite and > 0, got None"),
        ({"pressure_limit": 0.0}, "must be finite and > 0, got 0"),
        ({"pressure_limit": float("nan")}, "must be finite and > 0, got nan"),
        ({"pressure_limit": 300 * PSI, "unit": "psi"}, "limit of 300 psi is 1330 counts"),
        ({"jump_limit": 0.5 * PSI, "unit": "psi"}, "limit of 0.5 psi is 2 counts.*5 to 1023"),
        ({"jump_limit": float("nan")}, "0 counts"),
        ({"stall": 90.0}, "stall must be between 0.5 and 30 s, got 90 s"),
        ({"calibration": Calibration(Sensor(300, -50), Sensor(1, 0))}, "zero must be 0 to 1023"),
    ],
)
def test_settings_that_cannot_be_are_refused(changes, message):
    with pytest.raises(RigError, match=message):
        opened(SimulatedRig(), **changes)


def test_a_plan_above_the_limit_or_the_feed_forward_is_not_started():
    sim = SimulatedRig()
    with opened(sim, unit="psi") as rig:
        with pytest.raises(RigError, match=r"the plan sets 110 psi, but the limit is 110 psi"):
            run(rig, Isobaric((20 * PSI, LIMIT), 1, 0.01, 0.002))
        with pytest.raises(RigError, match=r"below the limit of 110 psi, got 110 psi"):
            rig.set_pressure(LIMIT)
        flat = FeedForward((128.0, 0, 0, 0), pressure_range=(0.0, 30 * PSI))
        rig.calibration = dataclasses.replace(rig.calibration, feed_forward=flat)
        with pytest.raises(RigError, match=r"is valid from 0 psi to 30 psi, not at 40"):
            run(rig, PLAN)
        assert sim.device.state == SAFE


def test_the_device_reports_what_its_twin_stores_of_the_settings(path):
    changes = {"jump_limit": 40 * PSI, "frozen_output": 6, "frozen": 0.5, "stall": 2.0}
    with recorded(path, **changes) as rig:
        settings = rig.link.session.settings
        wanted = stored_settings(rig.settings.commands(rig.calibration))
        sensor = rig.calibration.pressure
        assert sensor.value(5 * settings.trip) <= LIMIT < sensor.value(5 * (settings.trip + 1))
    assert settings.jump == wanted["jump"] == round(40 / (200 / (4.0 / 5 * 1024)))
    assert (settings.frozen, settings.frozen_ticks, settings.stall) == (6, 250, 1000)
    assert (settings.silence, settings.ticks_per_record) == (500, 5)
    (note,) = read_journal(path).notes_of("rig")
    assert (note["frozen_output_counts"], note["unseen"]) == (6, [])


def test_the_set_pressure_rises_evenly_where_the_plan_says_so(path):
    with recorded(path) as rig:
        run(rig, dataclasses.replace(PLAN, rise=2.0), machine=rig.link.rig.machine)
    columns = table(read_journal(path))
    block = (columns["block"] == 1) & (columns["state"] == RUN)
    time, wanted = columns["time_s"][block], columns["set_pressure_Pa"][block] / PSI
    even = np.interp(time - time[0], [0.0, 2.0], [20.0, 40.0])
    assert np.abs(wanted - even).max() < 1.2
    assert wanted[-1] == pytest.approx(40, abs=0.01)


@pytest.mark.parametrize("error", [ValueError("x"), KeyboardInterrupt(), SystemExit(1)])
def test_whatever_ends_a_test_vents(error, path):
    sim = SimulatedRig()
    with pytest.raises(type(error)), held(path, sim):
        assert sim.pressure > 35 * PSI
        raise error
    assert vented(sim)
    sim.advance(1.0)
    assert sim.pressure < 5 * PSI


def test_a_device_that_does_not_answer_is_never_left_with_heartbeats(path):
    sim = SimulatedRig()
    silent = r"did not confirm the stop.*check the pressure"
    with pytest.raises(RigFault, match=silent), held(path, sim):
        cable(sim, out=True)
    assert vented(sim)


@contextlib.contextmanager
def held(path, sim=None):
    """A rig under pressure, recorded."""
    with recorded(path, sim) as rig:
        rig.set_pressure(40 * PSI)
        rig.wait(2.0)
        yield rig


def test_cable_out_for_0_3_s_costs_nothing(path):
    with held(path) as rig:
        cable(rig.link.rig, out=True)
        rig.link.sleep(0.3)
        cable(rig.link.rig, out=False)
        rig.wait(2.0)
        assert rig.link.rig.device.state == RUN
    assert rig.link.session.recovered >= 25
    assert rig.lost == 0
    found = read_journal(path)
    assert (audit(found).faults, found.missing) == ([], ())


def test_cable_out_for_3_s_vents_and_the_gap_is_a_gap(path):
    sim = SimulatedRig()
    with held(path, sim) as rig:
        cable(sim, out=True)
        with pytest.raises(RigFault, match=r"silent for 1.0 s"):
            rig.wait(3.0)
        rig.link.sleep(2.0)
        assert vented(sim)
        assert sim.pressure < 5 * PSI
        cable(sim, out=False)
        rig.link.sleep(1.0)
        rig.check()
        rig.set_pressure(40 * PSI)  # and it runs again
        rig.wait(2.0)
    found = read_journal(path)
    lost = sum(gap.records for gap in found.missing)
    assert all(gap.noted for gap in found.missing)
    assert 300 - 64 - 5 < lost == rig.lost < 300
    times = table(found)["time_s"]
    assert np.diff(times).max() == pytest.approx(0.01 * (lost + 1), abs=0.01)
    assert audit(found).torn == 0


def test_a_hung_plan_vents_on_a_damaged_line_too(path):
    """What the link asks for by itself must not keep the device alive."""
    sim = SimulatedRig(to_host=FaultyChannel(seed=4, damage=0.02))
    with held(path, sim) as rig:
        rig.link.sleep(5.0 + 1.05)
        assert rig.link.session.recovered > 10
        assert rig.link.rig.device.state == SAFE


def test_a_reset_of_the_device_stops_the_plan(path):
    reset = r"was reset \(boot 0 to 1, cause 4\)"
    with pytest.raises(RigFault, match=reset), held(path) as rig:
        rig.link.rig.device.reset(4)
        rig.wait(2.0)
    assert read_journal(path).notes_of("reset")[0]["new"] == 1


def test_settings_that_change_in_a_test_and_a_rig_that_does_not_vent_are_told(path):
    with pytest.raises(RigFault, match="silence 5000 not 500"), held(path) as rig:
        rig.link.rig.device._control.silent = 5000
        rig.wait(2.0)
    with (
        pytest.raises(RigFault, match="close the supply"),
        opened(SimulatedRig()) as rig,
    ):
        rig.set_pressure(40 * PSI)
        rig.wait(3.0)
        step = rig.link.rig.plant.step
        rig.link.rig.plant.step = lambda _signal, _dump, length: step(0.502, 0.0, length)


def test_a_killed_or_suspended_host_vents_in_1_05_s_and_the_record_is_whole(path):
    """Whatever another host has set on a board that was not reset. The kernel keeps what comes in."""
    sim = SimulatedRig()
    for verb, value in (("hbms", 10_000), ("tele", 20), ("floor", 0), ("stall", 30_000)):
        VirtualLink(sim).command(verb, value)
    with held(path, sim) as rig:
        start = sim.now
        while sim.device.output:
            sim.advance(0.0005)
        assert sim.now - start <= 1.05
        sim.advance(2.0)
        assert vented(sim)
        assert sim.pressure < 5 * PSI
        with pytest.raises(RigFault, match=r"went to SAFE by itself: silence"):
            rig.wait(1.0)
    assert read_journal(path).missing == ()


def test_a_clock_that_drifts_is_mapped_to_a_millisecond(path):
    quick = Device(bytes_per_tick=100)  # a line goes out within the tick in which it is made
    sim = SimulatedRig(device=quick, clock_rate=0.003, to_host=ByteChannel())  # and without delay
    with held(path, sim) as rig:
        rig.wait(25.0)
    columns = table(read_journal(path))
    assert np.ptp(columns["time_s"] - columns["device_time_s"] / 1.003) < 1e-3


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="there is no /dev/full here")
def test_a_disk_that_is_truly_full_vents(monkeypatch):
    monkeypatch.setattr("rig.journal._sync_data", lambda _: None)
    sim = SimulatedRig()
    journal = journal_of(Path("/dev/full"), sim, append=True)
    full = r"cannot write /dev/full: No space left on device"
    with pytest.raises(RigFault, match=full), opened(sim, journal) as rig:
        rig.set_pressure(40 * PSI)
        rig.wait(60.0)
    with pytest.raises(RigFault, match=full):
        journal.close()
    assert vented(sim)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a named pipe")
def test_a_disk_that_takes_bytes_slowly_does_not_touch_the_heartbeats(path, tmp_path, monkeypatch):
    """A pipe that is read slowly: its writer waits as it would for a busy disk."""
    pipe, taken, go_on = tmp_path / "pipe.fam", bytearray(), threading.Event()
    os.mkfifo(pipe)

    def read_slowly():
        with pipe.open("rb", buffering=0) as disk:
            taken.extend(disk.read(1000))
            assert go_on.wait(20)
            while data := disk.read(65536):
                taken.extend(data)

    reader = threading.Thread(target=read_slowly)
    reader.start()
    monkeypatch.setattr("rig.journal._sync_data", lambda _: None)
    sim = SimulatedRig()
    with journal_of(pipe, sim, append=True) as journal:
        with opened(sim, journal) as rig:
            rig.set_pressure(40 * PSI)
            rig.wait(20.0)  # twenty times the limit of silence; a pipe holds 64 kB of them
            assert sim.device.state == RUN
            assert journal.waiting > 20_000
        go_on.set()
    reader.join(20)
    path.write_bytes(taken)
    found = audit(read_journal(path))
    assert found.sound
    assert found.checked > 2000


class Scripted(Attendant):
    """Does at each look what its function says; with a machine it starts strokes after four seconds."""

    def __init__(self, act):
        self.act, self.asked = act, 0.0
        self.told: list[str] = []
        self.seen: list[Situation] = []

    def tell(self, text):
        self.told.append(text)

    def look(self, situation):
        self.seen.append(situation)
        self.asked = self.asked + 1 if situation.phase == "ready" else 0
        return self.act(self, situation) or ""


def attended(path, person, sim=None, **more):
    with recorded(path, sim, unit="psi") as rig:
        run(rig, PLAN, attendant=person, **more)
    return read_journal(path)


def test_an_attendant_is_told_what_to_do_and_sees_how_far_the_plan_is(path):
    person = Scripted(lambda *_: None)
    attended(path, person)
    asked = [text for text in person.told if "start the strokes" in text]
    for block, text in enumerate(asked):
        assert text.startswith(f"block {block}: pressure held, ")
        assert text.endswith(f" of {20 + 20 * block} psi: start the strokes")
    assert [now.done + now.left for now in person.seen] == pytest.approx([26.0] * len(person.seen))
    assert np.diff([now.done for now in person.seen]).min() >= 0
    strokes = [now for now in person.seen if now.phase == "strokes"]
    assert {(now.block, now.cycle, now.cycles) for now in strokes} == {(0, 1, 1), (1, 1, 1)}


def at_look(asked):
    """Someone who types words at some looks, counted from the start."""
    return Scripted(lambda person, _: asked.get(len(person.seen)))


def test_a_paused_plan_stands_with_its_pressure_held(path):
    record = attended(path, person := at_look({40: "pause", 140: "begin"}))
    lasted = record.notes_of("end")[0]["at"] - record.notes_of("plan")[0]["at"]
    assert lasted == pytest.approx(26.0 + 5.0, abs=1.5)
    begin, end = record.notes_of("paused")[0]["at"], record.notes_of("went_on")[0]["at"]
    assert end - begin == pytest.approx(5.0, abs=0.3)
    assert np.ptp([now.done for now in person.seen if now.phase == "paused"]) == 0
    assert audit(record).sound


@pytest.mark.parametrize(
    ("word", "blocks", "done"), [("skip", [0, 1], [1]), ("repeat", [0, 0, 1], [0, 1])]
)
def test_a_pressure_is_skipped_or_repeated(path, word, blocks, done):
    record = attended(path, at_look({120: word}))
    assert [note["block"] for note in record.notes_of("block")] == blocks
    assert [note["block"] for note in record.notes_of("done")] == done
    assert record.notes_of(word)[0]["block"] == 0
    assert audit(record).sound
    assert [row["completed"] for row in summary(record)] == [
        b in done and (word == "skip" or k > 0) for k, b in enumerate(blocks)
    ]


@pytest.mark.parametrize("start", ["asked", "load"])
def test_strokes_are_waited_for(start, path):
    """Four seconds late each time: the run goes on once they have begun, and not before."""
    sim = SimulatedRig()

    def act(person, _):
        if person.asked == 80:
            sim.machine.start(PLAN.cycles, PLAN.rate, stroke=PLAN.stroke)
        return "begin" if start == "asked" and person.asked == 82 else None

    record = attended(path, Scripted(act), sim, start=start)
    for asked, began in zip(record.notes_of("set"), record.notes_of("strokes"), strict=True):
        assert began["at"] - asked["at"] == pytest.approx(3.0 + 4.0, abs=0.8)
        assert began["held"]
    log = read_machine_log(sim.machine.write_log(path.with_name("machine.csv")))
    found = analyse(record, log, rest_length=sim.machine.rest_length)
    assert [isobar.cycles for isobar in found.characterisation.isobars] == [1, 1]


def test_a_load_that_never_moves_ends_the_wait_after_60_s(path):
    sim = SimulatedRig(device=Wired(lambda pressure, _: (pressure, 141)))  # a dead load cell
    with pytest.raises(RigFault, match=r"has not changed for 60 s.*load cell is dead"):
        attended(path, Scripted(lambda *_: None), sim, start="load")
    record = read_journal(path)
    (note,), (set_,) = record.notes_of("fault"), record.notes_of("set")
    assert note["at"] - set_["at"] == pytest.approx(3 + 60, abs=3)


def test_begin_is_not_obeyed_before_the_pressure_is_held():
    """So slow a controller never holds it."""

    def act(person, _):
        if person.asked > 40:
            raise KeyboardInterrupt
        return "begin"

    person, plan = Scripted(act), Isobaric((60 * PSI,), 1, 0.01, 0.01, settle=0.5)
    slow = opened(SimulatedRig(), control=Control.per_psi(0, 0.01))
    with pytest.raises(KeyboardInterrupt), slow as rig:
        run(rig, plan, attendant=person, start="asked")
    assert "pressure NOT held" in person.told[0]
    assert "do not start" in person.told[0]
    assert person.told[1].startswith("not yet: the set pressure has not been reached")


def test_the_calibration_in_the_readme_holds_a_pressure(tmp_path, monkeypatch):
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
