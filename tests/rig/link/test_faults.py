"""What goes wrong in a laboratory, row by row: the device vents, the recorder knows, nothing is made up."""

# ruff: noqa: PT012 -- the way out of a with block is what is tested

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from faulty_channel import FaultyChannel

from famjax.app.isobaric import table
from rig.control import Control, Rig
from rig.device import Device
from rig.errors import RigFault
from rig.journal import Journal, audit, read_journal
from rig.link import VirtualLink
from rig.protocol import FAULTS, RUN, SAFE
from rig.simulation import ByteChannel, SimulatedRig

PSI = 6894.757293168361
LIMIT = 110 * PSI
PRESSURE = 40 * PSI


class Bench:
    """A rig under pressure, recorded, in virtual time."""

    def __init__(self, path: Path, sim: SimulatedRig | None = None, **options: object) -> None:
        self.sim = sim or SimulatedRig()
        self.path = path
        self.journal = Journal(path, lambda: self.sim.now, reserve_bytes=0, **options)
        self.rig = Rig(
            VirtualLink(self.sim),
            self.sim.calibration(),
            pressure_limit=LIMIT,
            control=Control.per_psi(4, 2),
            journal=self.journal,
        )

    def __enter__(self) -> "Bench":
        self.rig.__enter__()
        self.rig.set_pressure(PRESSURE)
        self.rig.wait(2.0)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self.rig.__exit__(None, error, None)
        finally:
            self.journal.close()

    def cut(self, seconds: float) -> None:
        """The cable is out; the device runs on its own supply."""
        self.set_cut(True)
        self.rig.link.keep_alive()
        self.rig.link.sleep(seconds)
        self.set_cut(False)

    def set_cut(self, out: bool) -> None:
        self.sim.to_host.cut = self.sim.to_device.cut = out

    def time_to_vent(self, limit: float) -> float:
        """Until the output is off, nobody driving the host."""
        start = self.sim.now
        while self.sim.device.output > 0 or self.sim.device.state == RUN:
            self.sim.advance(0.0005)
            assert self.sim.now - start < limit
        return self.sim.now - start


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "run.fam")


def test_cable_out_for_0_3_s_costs_nothing(bench: Bench) -> None:
    with bench:
        bench.cut(0.3)
        bench.rig.wait(2.0)
        assert bench.sim.device.state == RUN
    found = read_journal(bench.path)
    assert found.missing == ()
    assert bench.rig.link.session.recovered >= 25
    assert bench.rig.lost == 0
    assert audit(found).sound


def test_cable_out_for_3_s_vents_and_the_gap_is_a_gap(bench: Bench) -> None:
    with bench:
        with pytest.raises(RigFault, match=r"silent for 1.0 s"):
            bench.set_cut(True)
            bench.rig.wait(3.0)
        bench.rig.link.sleep(2.0)
        assert (bench.sim.device.state, bench.sim.device.output) == (SAFE, 0)
        assert bench.sim.pressure < 5 * PSI
        bench.set_cut(False)
        bench.rig.link.sleep(1.0)
        bench.rig.check()
        bench.rig.set_pressure(PRESSURE)  # and it runs again
        bench.rig.wait(2.0)
    found = read_journal(bench.path)
    lost = sum(gap.records for gap in found.missing)
    assert all(gap.noted for gap in found.missing)
    assert 300 - 64 - 5 < lost == bench.rig.lost < 300
    times = table(found)["time_s"]
    assert np.diff(times).max() == pytest.approx(0.01 * (lost + 1), abs=0.01)
    assert audit(found).torn == 0


def test_damaged_dropped_and_doubled_bytes_cost_nothing(tmp_path: Path) -> None:
    faults = {"damage": 0.004, "drop": 0.002, "duplicate": 0.002}
    sim = SimulatedRig(
        to_device=FaultyChannel(baud=115200, seed=1, limit=4096, **faults),
        to_host=FaultyChannel(seed=2, **faults),
    )
    with Bench(tmp_path / "run.fam", sim) as bench:
        bench.rig.wait(20.0)
    found = audit(read_journal(bench.path))
    assert found.sound
    assert (found.lost, found.unchecked) == (0, 0)
    assert found.checked == found.records > 2000


def test_a_reset_of_the_device_stops_the_plan(bench: Bench) -> None:
    with bench, pytest.raises(RigFault, match=r"was reset \(boot 0 to 1, cause 4\)"):
        bench.sim.device.reset(4)
        bench.rig.wait(2.0)
    assert bench.sim.device.output == 0
    assert read_journal(bench.path).notes_of("reset")[0]["new"] == 1


def test_a_killed_host_vents_in_1_05_s(bench: Bench) -> None:
    bench.__enter__()
    assert bench.time_to_vent(3.0) <= 1.05
    assert FAULTS[bench.sim.device.fault] == "silence"
    bench.sim.advance(0.5)
    assert bench.sim.pressure < 5 * PSI
    bench.rig.link.attach(None)
    bench.journal.close()


def test_a_hung_plan_vents_on_a_damaged_line_too(tmp_path: Path) -> None:
    """What the link asks for by itself must not keep the device alive."""
    sim = SimulatedRig(
        to_device=FaultyChannel(baud=115200, seed=3, limit=4096),
        to_host=FaultyChannel(seed=4, damage=0.02),
    )
    with Bench(tmp_path / "run.fam", sim) as bench:
        bench.rig.link.sleep(5.0 + 1.05)
        assert bench.rig.link.session.recovered > 10
        assert bench.sim.device.state == SAFE


def test_a_suspended_host_finds_the_rig_vented_and_the_record_whole(bench: Bench) -> None:
    """The kernel keeps what comes in meanwhile."""
    with bench:
        assert bench.time_to_vent(3.0) <= 1.05
        bench.sim.advance(2.0)
        with pytest.raises(RigFault, match=r"went to SAFE by itself: silence"):
            bench.rig.wait(1.0)
    assert read_journal(bench.path).missing == ()


needs_dev_full = pytest.mark.skipif(
    not Path("/dev/full").is_char_device(), reason="there is no /dev/full here"
)


@needs_dev_full
def test_a_disk_that_is_truly_full_vents(monkeypatch: pytest.MonkeyPatch) -> None:
    """/dev/full refuses every byte as a full disk does."""
    monkeypatch.setattr("rig.journal._sync_data", lambda _: None)
    bench = Bench(Path("/dev/full"), append=True)
    with (
        pytest.raises(RigFault, match=r"cannot write /dev/full: No space left on device"),
        bench.rig,
    ):
        bench.rig.set_pressure(PRESSURE)
        while True:
            bench.rig.wait(0.1)
    with pytest.raises(RigFault, match=r"No space left on device"):
        bench.journal.close()
    assert (bench.sim.device.state, bench.sim.device.output) == (SAFE, 0)


LIMITED = """
import resource, sys
from pathlib import Path
sys.path[:0] = {folders!r}
from test_faults import Bench, RigFault, SAFE
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
with Bench(Path({path!r})) as bench:
    try:
        while True:
            bench.rig.wait(0.1)
    except RigFault as fault:
        print(fault)
    try:
        bench.journal.close()
    except RigFault:
        pass
print((bench.sim.device.state, bench.sim.device.output) == (SAFE, 0))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs setrlimit")
@pytest.mark.parametrize("size", [90_000, 121_001])
def test_a_file_that_may_not_grow_keeps_all_that_it_took(size: int, tmp_path: Path) -> None:
    """A true short write in the middle of a line, then a refusal, in a process of its own."""
    path = tmp_path / "run.fam"
    folders = [str(folder) for folder in Path(__file__).parents[:2]]
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
    pipe = tmp_path / "pipe.fam"
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
    with Bench(pipe, append=True) as bench:
        bench.rig.wait(30.0)  # thirty times the limit of silence; a pipe holds 64 kB of them
        assert bench.sim.device.state == RUN
        assert bench.journal.waiting > 50_000
        go_on.set()
    reader.join(20)
    (tmp_path / "run.fam").write_bytes(taken)
    found = audit(read_journal(tmp_path / "run.fam"))
    assert found.sound
    assert found.checked > 3000


def test_over_pressure_trips_within_7_ms(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "run.fam")
    with bench:
        bench.sim.sensor_fault = bench.rig.link.session.settings.trip
        assert bench.time_to_vent(0.1) <= 0.0071
        with pytest.raises(RigFault, match=r"over-pressure|jump"):
            bench.rig.wait(1.0)


def test_a_clock_that_drifts_is_mapped_to_a_millisecond(tmp_path: Path) -> None:
    quick = Device(bytes_per_tick=100)  # a line goes out within the tick in which it is made
    sim = SimulatedRig(device=quick, clock_rate=0.003, to_host=ByteChannel())  # and without delay
    with Bench(tmp_path / "run.fam", sim) as bench:
        bench.rig.wait(60.0)
    columns = table(read_journal(bench.path))
    late = columns["time_s"] - columns["device_time_s"] / 1.003
    assert np.ptp(late) < 1e-3
