"""The simulated rig as its host sees it, and whole tests through files, against what is true."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from famjax.app.isobaric import analyse
from famjax.app.simulation import SimulatedTest, simulate
from famjax.plant import LinearMcKibben
from fitting import read_csv
from fitting.records import read_machine_log
from rig import Rig, RigFault, audit, read_journal
from rig.control import Control
from rig.link import VirtualLink
from rig.plan import Isobaric, PlanFile
from rig.protocol import Sample, Splitter, parse
from rig.simulation import (
    ByteChannel,
    HydraulicCircuit,
    MachineClock,
    PneumaticCircuit,
    SimulatedRig,
)

PSI, INCH, POUND = 6894.757293168361, 0.0254, 4.4482216152605
GAINS = {"air": Control.per_psi(4, 2), "water": Control.per_psi(0, 5)}  # table 3.2, 7/8 in
LIMIT = 115 * PSI


def test_the_bytes_do_not_depend_on_the_steps() -> None:
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
def test_the_device_counts_by_its_own_clock(rate: float) -> None:
    rig = SimulatedRig(clock_rate=rate)
    rig.advance(20.0)
    *_, last = (m for m in map(parse, Splitter().feed(rig.read())) if isinstance(m, Sample))
    assert last.tick * 2e-3 == pytest.approx(20.0 * (1 + rate), abs=0.02)  # a record and its line


CIRCUITS = {"air": PneumaticCircuit, "water": HydraulicCircuit}


@pytest.mark.parametrize("fluid", ["air", "water"])
def test_an_unplugged_sensor_trips_and_vents(fluid: str) -> None:
    sim = SimulatedRig(CIRCUITS[fluid]())

    def held() -> None:
        link = VirtualLink(sim)
        with Rig(link, sim.calibration(), pressure_limit=LIMIT, control=GAINS[fluid]) as rig:
            rig.set_pressure(60 * PSI)
            rig.wait(8.0)
            assert sim.pressure == pytest.approx(60 * PSI, abs=1.5 * PSI)
            sim.sensor_fault, before = 1023, sim.now
            while sim.device.output:
                sim.advance(1e-3)
            assert sim.now - before < 8e-3  # three conversions and the phase
            sim.advance(0.3)
            assert sim.pressure < 5 * PSI
            rig.wait(1.0)

    with pytest.raises(RigFault, match="TRIP"):
        held()


def whole_test(folder: Path, fluid: str, pressures: tuple[float, ...], **options) -> SimulatedTest:
    plan = Isobaric(
        tuple(p * PSI for p in pressures), cycles=1, stroke=options.pop("stroke", 3.4 * INCH),
        rate=options.pop("rate", 0.04 * INCH), settle=5.0,
    )  # fmt: skip
    return simulate(PlanFile(plan, fluid, LIMIT, GAINS[fluid]), folder, **options)


@pytest.fixture(scope="module")
def air(tmp_path_factory: pytest.TempPathFactory) -> SimulatedTest:
    return whole_test(tmp_path_factory.mktemp("air"), "air", (30, 70), rate=0.06 * INCH, seed=3)


@pytest.mark.slow
def test_a_whole_test_finds_the_muscle_that_was_simulated(air: SimulatedTest) -> None:
    muscle = LinearMcKibben()
    for bar in air.analysis.characterisation.isobars:
        truth = np.asarray(muscle.force(bar.length, bar.set_pressure))
        inner = slice(8, -3)  # beyond the pressure's dip at the turn
        # Friction is 2 % to either side; 0.3 psi of pressure are 3 lbf.
        assert np.abs(bar.force - truth)[inner].max() < 4 * POUND
        half = (bar.lengthening - bar.shortening)[inner] / 2
        assert np.abs(half - 0.02 * truth[inner]).max() < 4 * POUND
        blocked, free = (
            muscle.blocked_force(bar.set_pressure),
            muscle.free_contraction(bar.set_pressure),
        )
        assert bar.blocked_force == pytest.approx(float(blocked), rel=0.03)
        assert bar.free_contraction == pytest.approx(float(free), abs=0.003)


@pytest.mark.slow
def test_its_journal_is_sound_and_its_dataset_is_read_by_a_fit(air: SimulatedTest) -> None:
    found = audit(read_journal(air.paths[0]))
    assert found.sound
    assert found.checked == found.equal > 10_000
    assert found.lost == 0
    data = read_csv(air.paths[2])
    assert data.specimen.rest_length == LinearMcKibben().rest_length
    assert data.max_force == pytest.approx(720 * POUND, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("fluid", ["air", "water"])
def test_published_gains_hold_the_published_pressure(fluid: str, tmp_path: Path) -> None:
    """Chapter 3: 0.02 in/s; 20 and 100 psi. Mean within 0.1 psi, deviation 0.15 to 0.45 psi."""
    done = whole_test(tmp_path, fluid, (20, 100), rate=0.02 * INCH, seed=11)
    for bar in done.analysis.characterisation.isobars:
        assert abs(bar.pressure - bar.set_pressure) < 0.1 * PSI
        assert 0.15 * PSI < bar.pressure_std < 0.45 * PSI


@pytest.mark.slow
def test_the_pulses_of_a_plan_align_a_log_as_its_load_does(tmp_path: Path) -> None:
    """From plan to analysis; also where the log begins late, or has 25 rows a second."""
    clock = MachineClock(31.0, -2e-4)
    done = whole_test(
        tmp_path, "air", (30, 50, 70, 45), stroke=INCH, rate=0.06 * INCH, seed=22,
        clock=clock, clock_rate=2e-3, baud=500000,
    )  # fmt: skip
    journal, log = read_journal(done.paths[0]), read_machine_log(done.paths[1])
    assert audit(journal).sound
    assert len(journal.notes_of("sync")) == 4
    rows = log.time.size
    for first, step, edges in ((0, 1, 8), (rows // 3, 1, 4), (0, 2, 8)):
        kept = slice(first, None, step)
        part = dataclasses.replace(
            log, time=log.time[kept], displacement=log.displacement[kept], force=log.force[kept],
            others={name: v[kept] for name, v in log.others.items()}, interval=step * log.interval,
        )  # fmt: skip
        rest_length = float(LinearMcKibben().rest_length)
        found = analyse(
            journal, part, rest_length=rest_length, sync_column="Digital input (-)"
        ).alignment
        assert found.n == edges
        at = np.array(found.reference)
        true = (found.reference - clock.offset) / (1 + clock.rate)
        # Three standard errors; the host hears of a record up to 2 ms late.
        assert abs(float(found.journal_time(at)) - true) < 3 * found.offset_error + 2e-3
        assert found.offset_error < 0.006 * step
