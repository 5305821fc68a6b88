"""What goes wrong in a laboratory, row by row: the device vents, the recorder knows, nothing is made up."""

# ruff: noqa: PT012 -- the way out of a with block is what is tested

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from benches import PSI, journal_of, opened, vented
from faulty_channel import FaultyChannel

from famjax.app.isobaric import table
from rig.device import Device
from rig.errors import RigFault
from rig.journal import Journal, audit, read_journal
from rig.protocol import RUN, SAFE
from rig.simulation import ByteChannel, SimulatedRig

PRESSURE = 40 * PSI


class Running:
    """A rig under pressure, recorded, in virtual time."""

    def __init__(self, journal: Path | Journal, sim: SimulatedRig | None = None) -> None:
        self.sim = sim or SimulatedRig()
        self.journal = journal_of(journal, self.sim) if isinstance(journal, Path) else journal
        self.rig = opened(self.sim, self.journal)

    def __enter__(self) -> "Running":
        self.rig.__enter__()
        self.rig.set_pressure(PRESSURE)
        self.rig.wait(2.0)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self.rig.__exit__(None, error, None)
        finally:
            self.journal.close()

    def cut(self, out: bool, seconds: float = 0.0) -> None:
        """The cable is out or in; the device runs on its own supply."""
        self.sim.to_host.cut = self.sim.to_device.cut = out
        self.rig.link.keep_alive()
        self.rig.link.sleep(seconds)

    def time_to_vent(self, limit: float) -> float:
        """Until the output is off, nobody driving the host."""
        start = self.sim.now
        while self.sim.device.output > 0 or self.sim.device.state == RUN:
            self.sim.advance(0.0005)
            assert self.sim.now - start < limit
        return self.sim.now - start


def test_cable_out_for_0_3_s_costs_nothing(path: Path) -> None:
    with Running(path) as test:
        test.cut(True, 0.3)
        test.cut(False)
        test.rig.wait(2.0)
        assert test.sim.device.state == RUN
    assert test.rig.link.session.recovered >= 25
    assert test.rig.lost == 0
    assert audit(read_journal(path)).faults == []
    assert read_journal(path).missing == ()


def test_cable_out_for_3_s_vents_and_the_gap_is_a_gap(path: Path) -> None:
    with Running(path) as test:
        with pytest.raises(RigFault, match=r"silent for 1.0 s"):
            test.cut(True)
            test.rig.wait(3.0)
        test.rig.link.sleep(2.0)
        assert vented(test.sim)
        assert test.sim.pressure < 5 * PSI
        test.cut(False, 1.0)
        test.rig.check()
        test.rig.set_pressure(PRESSURE)  # and it runs again
        test.rig.wait(2.0)
    found = read_journal(path)
    lost = sum(gap.records for gap in found.missing)
    assert all(gap.noted for gap in found.missing)
    assert 300 - 64 - 5 < lost == test.rig.lost < 300
    times = table(found)["time_s"]
    assert np.diff(times).max() == pytest.approx(0.01 * (lost + 1), abs=0.01)
    assert audit(found).torn == 0


def test_damaged_dropped_and_doubled_bytes_cost_nothing(path: Path) -> None:
    faults = {"damage": 0.004, "drop": 0.002, "duplicate": 0.002}
    sim = SimulatedRig(
        to_device=FaultyChannel(baud=115200, seed=1, limit=4096, **faults),
        to_host=FaultyChannel(seed=2, **faults),
    )
    with Running(path, sim) as test:
        test.rig.wait(8.0)
    found = audit(read_journal(path))
    assert found.sound
    assert (found.lost, found.unchecked) == (0, 0)
    assert found.checked == found.records > 900


def test_a_reset_of_the_device_stops_the_plan(path: Path) -> None:
    with (
        Running(path) as test,
        pytest.raises(RigFault, match=r"was reset \(boot 0 to 1, cause 4\)"),
    ):
        test.sim.device.reset(4)
        test.rig.wait(2.0)
    assert test.sim.device.output == 0
    assert read_journal(path).notes_of("reset")[0]["new"] == 1


def test_a_killed_or_suspended_host_vents_in_1_05_s_and_the_record_is_whole(path: Path) -> None:
    """The kernel keeps what comes in meanwhile."""
    with Running(path) as test:
        assert test.time_to_vent(3.0) <= 1.05
        test.sim.advance(2.0)
        assert test.sim.pressure < 5 * PSI
        with pytest.raises(RigFault, match=r"went to SAFE by itself: silence"):
            test.rig.wait(1.0)
    assert read_journal(path).missing == ()


def test_a_hung_plan_vents_on_a_damaged_line_too(path: Path) -> None:
    """What the link asks for by itself must not keep the device alive."""
    sim = SimulatedRig(
        to_device=FaultyChannel(baud=115200, seed=3, limit=4096),
        to_host=FaultyChannel(seed=4, damage=0.02),
    )
    with Running(path, sim) as test:
        test.rig.link.sleep(5.0 + 1.05)
        assert test.rig.link.session.recovered > 10
        assert test.sim.device.state == SAFE


def test_over_pressure_trips_within_7_ms(path: Path) -> None:
    with Running(path) as test:
        test.sim.sensor_fault = test.rig.link.session.settings.trip
        assert test.time_to_vent(0.1) <= 0.0071
        with pytest.raises(RigFault, match=r"over-pressure|jump"):
            test.rig.wait(1.0)


def test_a_clock_that_drifts_is_mapped_to_a_millisecond(path: Path) -> None:
    quick = Device(bytes_per_tick=100)  # a line goes out within the tick in which it is made
    sim = SimulatedRig(device=quick, clock_rate=0.003, to_host=ByteChannel())  # and without delay
    with Running(path, sim) as test:
        test.rig.wait(25.0)
    columns = table(read_journal(path))
    assert np.ptp(columns["time_s"] - columns["device_time_s"] / 1.003) < 1e-3


# ---- disks ----


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="there is no /dev/full here")
def test_a_disk_that_is_truly_full_vents(monkeypatch: pytest.MonkeyPatch) -> None:
    """/dev/full refuses every byte as a full disk does."""
    monkeypatch.setattr("rig.journal._sync_data", lambda _: None)
    sim = SimulatedRig()
    journal = journal_of(Path("/dev/full"), sim, append=True)
    with (
        pytest.raises(RigFault, match=r"cannot write /dev/full: No space left on device"),
        opened(sim, journal) as rig,
    ):
        rig.set_pressure(PRESSURE)
        while True:
            rig.wait(0.1)
    with pytest.raises(RigFault, match=r"No space left on device"):
        journal.close()
    assert vented(sim)


LIMITED = """
import resource, sys
from pathlib import Path
sys.path[:0] = {folders!r}
from test_faults import RigFault, Running, vented
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
with Running(Path({path!r})) as test:
    try:
        while True:
            test.rig.wait(0.1)
    except RigFault as fault:
        print(fault)
    try:
        test.journal.close()
    except RigFault:
        pass
print(vented(test.sim))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs setrlimit")
def test_a_file_that_may_not_grow_keeps_all_that_it_took(path: Path) -> None:
    """A true short write in the middle of a line, then a refusal, in a process of its own."""
    size = 60_001
    folders = [str(folder) for folder in (Path(__file__).parent, Path(__file__).parents[2])]
    script = LIMITED.format(folders=folders, size=size, path=str(path))
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.splitlines() == [f"cannot write {path}: File too large", "True"]
    assert path.stat().st_size == size
    found = read_journal(path)
    assert found.missing == ()
    lines = path.read_bytes().split(b"\n")[:-1]
    assert len(found.rows) == sum(line.startswith(b"T,") for line in lines) > size // 60
    assert found.damaged_bytes < 80  # the line that was cut short


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a named pipe")
def test_a_disk_that_takes_bytes_slowly_does_not_touch_the_heartbeats(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pipe that is read slowly: its writer waits as it would for a busy disk."""
    pipe, path = tmp_path / "pipe.fam", tmp_path / "run.fam"
    os.mkfifo(pipe)
    taken, go_on = bytearray(), threading.Event()

    def read_slowly() -> None:
        with pipe.open("rb", buffering=0) as disk:
            taken.extend(disk.read(1000))
            assert go_on.wait(20)
            while not taken.rstrip(b"\n").split(b"\n")[-1].startswith(b'{"note":"end"'):
                taken.extend(disk.read(65536))

    reader = threading.Thread(target=read_slowly)
    reader.start()
    monkeypatch.setattr("rig.journal._sync_data", lambda _: None)
    sim = SimulatedRig()
    with Running(journal_of(pipe, sim, append=True), sim) as test:
        test.rig.wait(20.0)  # twenty times the limit of silence; a pipe holds 64 kB of them
        assert sim.device.state == RUN
        assert test.journal.waiting > 20_000
        go_on.set()
    reader.join(20)
    path.write_bytes(taken)
    found = audit(read_journal(path))
    assert found.sound
    assert found.checked > 2000
