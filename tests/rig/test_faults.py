"""What goes wrong in a laboratory, row by row: the device vents, the recorder knows, nothing is made up."""

# ruff: noqa: PT012 -- the way out of a with block is what is tested

import contextlib
import os
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from benches import PSI, journal_of, opened, recorded, vented
from faulty_channel import FaultyChannel

from famjax.app.isobaric import table
from rig.device import Device
from rig.errors import RigFault
from rig.journal import audit, read_journal
from rig.link import VirtualLink
from rig.protocol import RUN, SAFE
from rig.simulation import ByteChannel, SimulatedRig

PRESSURE = 40 * PSI


@contextlib.contextmanager
def held(path, sim):
    """A rig under pressure, recorded, in virtual time."""
    with recorded(path, sim) as rig:
        rig.set_pressure(PRESSURE)
        rig.wait(2.0)
        yield rig


def cable(sim, *, out):
    """The device runs on its own supply."""
    sim.to_host.cut = sim.to_device.cut = out


def test_cable_out_for_0_3_s_costs_nothing(path):
    sim = SimulatedRig()
    with held(path, sim) as rig:
        cable(sim, out=True)
        rig.link.sleep(0.3)
        cable(sim, out=False)
        rig.wait(2.0)
        assert sim.device.state == RUN
    assert rig.link.session.recovered >= 25
    assert rig.lost == 0
    assert audit(read_journal(path)).faults == []
    assert read_journal(path).missing == ()


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
        rig.set_pressure(PRESSURE)  # and it runs again
        rig.wait(2.0)
    found = read_journal(path)
    lost = sum(gap.records for gap in found.missing)
    assert all(gap.noted for gap in found.missing)
    assert 300 - 64 - 5 < lost == rig.lost < 300
    times = table(found)["time_s"]
    assert np.diff(times).max() == pytest.approx(0.01 * (lost + 1), abs=0.01)
    assert audit(found).torn == 0


def test_damaged_dropped_and_doubled_bytes_cost_nothing(path):
    faults = {"damage": 0.004, "drop": 0.002, "duplicate": 0.002}
    sim = SimulatedRig(
        to_device=FaultyChannel(baud=115200, seed=1, limit=4096, **faults),
        to_host=FaultyChannel(seed=2, **faults),
    )
    with held(path, sim) as rig:
        rig.wait(8.0)
    found = audit(read_journal(path))
    assert found.sound
    assert (found.lost, found.unchecked) == (0, 0)
    assert found.checked == found.records > 900


def test_a_reset_of_the_device_stops_the_plan(path):
    sim = SimulatedRig()
    reset = r"was reset \(boot 0 to 1, cause 4\)"
    with pytest.raises(RigFault, match=reset), held(path, sim) as rig:
        sim.device.reset(4)
        rig.wait(2.0)
    assert read_journal(path).notes_of("reset")[0]["new"] == 1


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


def test_a_hung_plan_vents_on_a_damaged_line_too(path):
    """What the link asks for by itself must not keep the device alive."""
    sim = SimulatedRig(
        to_device=FaultyChannel(baud=115200, seed=3, limit=4096),
        to_host=FaultyChannel(seed=4, damage=0.02),
    )
    with held(path, sim) as rig:
        rig.link.sleep(5.0 + 1.05)
        assert rig.link.session.recovered > 10
        assert sim.device.state == SAFE


def test_a_clock_that_drifts_is_mapped_to_a_millisecond(path):
    quick = Device(bytes_per_tick=100)  # a line goes out within the tick in which it is made
    sim = SimulatedRig(device=quick, clock_rate=0.003, to_host=ByteChannel())  # and without delay
    with held(path, sim) as rig:
        rig.wait(25.0)
    columns = table(read_journal(path))
    assert np.ptp(columns["time_s"] - columns["device_time_s"] / 1.003) < 1e-3


# ---- disks ----


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="there is no /dev/full here")
def test_a_disk_that_is_truly_full_vents(monkeypatch):
    """/dev/full refuses every byte as a full disk does."""
    monkeypatch.setattr("rig.journal._sync_data", lambda _: None)
    sim = SimulatedRig()
    journal = journal_of(Path("/dev/full"), sim, append=True)
    full = r"cannot write /dev/full: No space left on device"
    with pytest.raises(RigFault, match=full), opened(sim, journal) as rig:
        rig.set_pressure(PRESSURE)
        rig.wait(60.0)
    with pytest.raises(RigFault, match=full):
        journal.close()
    assert vented(sim)


@pytest.mark.skipif(sys.platform == "win32", reason="needs setrlimit")
def test_a_file_that_may_not_grow_keeps_all_that_it_took(path):
    """A true short write in the middle of a line, then a refusal."""
    import resource

    sim, size, before = SimulatedRig(), 60_001, resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        with pytest.raises(RigFault, match=r"run.fam: File too large"), held(path, sim) as rig:
            rig.wait(60.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert vented(sim)
    assert path.stat().st_size == size
    found = read_journal(path)
    assert found.missing == ()
    lines = path.read_bytes().split(b"\n")[:-1]
    assert len(found.rows) == sum(line.startswith(b"T,") for line in lines) > size // 60
    assert found.damaged_bytes < 80  # the line that was cut short


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
            rig.set_pressure(PRESSURE)
            rig.wait(20.0)  # twenty times the limit of silence; a pipe holds 64 kB of them
            assert sim.device.state == RUN
            assert journal.waiting > 20_000
        go_on.set()
    reader.join(20)
    path.write_bytes(taken)
    found = audit(read_journal(path))
    assert found.sound
    assert found.checked > 2000
