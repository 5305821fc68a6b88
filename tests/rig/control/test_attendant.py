"""A run that somebody attends: the plan stands, a block is left or begun anew, strokes are waited for."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from famjax.app.isobaric import analyse, table
from famjax.app.simulation import Watcher
from fitting.records import read_machine_log
from rig.cli import CameraCommand
from rig.control import Control, Rig
from rig.errors import RigError
from rig.execution import Attendant, Request, Situation, run
from rig.journal import Journal, audit, read_journal
from rig.link import VirtualLink
from rig.plan import Isobaric, next_block
from rig.simulation import MachineClock, PneumaticCircuit, SimulatedRig, machine_for, mckibben

PSI = 6894.757293168361
GAINS = Control.per_psi(4, 2)
PLAN = Isobaric((20 * PSI, 40 * PSI), cycles=2, stroke=0.01, rate=0.002, settle=3.0)


class Scripted(Attendant):
    """Asks once for each thing where its condition holds, in their order."""

    def __init__(self, *acts: tuple[Callable[[Situation], bool], Request]) -> None:
        self.acts = list(acts)
        self.told: list[str] = []
        self.seen: list[Situation] = []

    def tell(self, text: str) -> None:
        self.told.append(text)

    def look(self, situation: Situation) -> Request:
        self.seen.append(situation)
        if self.acts and self.acts[0][0](situation):
            return self.acts.pop(0)[1]
        return ""


def attended(
    path: Path, attendant: Attendant, sim: SimulatedRig | None = None, **options: object
) -> SimulatedRig:
    sim = sim or SimulatedRig()
    with (
        Journal(path, lambda: sim.now, reserve_bytes=0) as journal,
        Rig(
            VirtualLink(sim), sim.calibration(), pressure_limit=110 * PSI, control=GAINS,
            journal=journal,
        ) as rig,
    ):  # fmt: skip
        run(rig, PLAN, attendant=attendant, **options)
    assert (sim.device.output, sim.device.dump_open) == (0, True)
    return sim


def in_phase(phase: str, block: int, done: float = 0.0) -> Callable[[Situation], bool]:
    return lambda now: now.phase == phase and now.block == block and now.done >= done


def later(seconds: float) -> Callable[[Situation], bool]:
    """So many looks of 50 ms after the act before it."""
    left = [round(seconds / 0.05)]

    def passed(_: Situation) -> bool:
        left[0] -= 1
        return left[0] < 0

    return passed


def test_what_an_attendant_sees(tmp_path: Path) -> None:
    person = Scripted()
    attended(tmp_path / "test.fam", person)
    for block, text in enumerate(person.told):
        assert text.startswith(f"block {block}: pressure held, ")
        assert text.endswith("start the strokes: 2 of 10 mm at 2 mm/s, 20 s")
    strokes = [now for now in person.seen if now.phase == "strokes"]
    assert sorted({(now.block, now.cycle) for now in strokes}) == [(0, 1), (0, 2), (1, 1), (1, 2)]
    assert all(now.cycles == 2 and now.last_block == 1 for now in strokes)
    assert [now.done + now.left for now in person.seen] == pytest.approx([46.0] * len(person.seen))
    assert np.diff([now.done for now in person.seen]).min() >= 0
    assert all(abs(now.pressure - now.set_point) < 2 * PSI for now in strokes)


def test_a_paused_plan_stands_with_its_pressure_held(tmp_path: Path) -> None:
    person = Scripted((in_phase("settling", 1), "pause"), (later(7.0), "pause"))
    attended(tmp_path / "test.fam", person)
    record = read_journal(tmp_path / "test.fam")
    lasted = record.notes_of("end")[0]["at"] - record.notes_of("plan")[0]["at"]
    assert lasted == pytest.approx(46.0 + 7.0, abs=1.5)
    begin, end = record.notes_of("paused")[0]["at"], record.notes_of("went_on")[0]["at"]
    assert end - begin == pytest.approx(7.0, abs=0.3)
    columns = table(record)
    held = (columns["time_s"] > end - 3) & (columns["time_s"] < end)
    assert np.abs(columns["pressure_Pa"][held] - 40 * PSI).max() < 2 * PSI
    paused = [now for now in person.seen if now.phase == "paused"]
    assert np.ptp([now.done for now in paused]) == 0
    assert record.notes_of("end")[-1]["reason"] == "complete"
    assert audit(record).sound


def test_go_ends_a_pause(tmp_path: Path) -> None:
    person = Scripted((in_phase("strokes", 0), "pause"), (later(2.0), "begin"))
    attended(tmp_path / "test.fam", person)
    assert [text for text in person.told if "goes on" in text] == ["block 0: goes on"]
    assert not person.acts


def test_a_block_that_is_skipped_is_not_resumed(tmp_path: Path) -> None:
    path = tmp_path / "test.fam"
    attended(path, Scripted((in_phase("strokes", 1), "skip")))
    notes = read_journal(path).notes
    assert [note["block"] for note in notes if note["note"] == "done"] == [0]
    assert [note["block"] for note in notes if note["note"] == "skipped"] == [1]
    assert next_block(notes) == 2


def test_a_block_that_is_repeated_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "test.fam"
    attended(path, Scripted((in_phase("strokes", 0, 8.0), "repeat")))
    record = read_journal(path)
    assert [note["block"] for note in record.notes_of("block")] == [0, 0, 1]
    assert [note["block"] for note in record.notes_of("done")] == [0, 1]
    assert [note["block"] for note in record.notes_of("repeated")] == [0]


class ByHand(Scripted):
    """Starts the machine some seconds after it was asked to, as a person does."""

    machine = None

    def tell(self, text: str) -> None:
        super().tell(text)
        self.since = 0

    def look(self, situation: Situation) -> Request:
        if situation.phase == "ready":
            self.since += 1
            if self.since == 80:
                self.machine.start(PLAN.cycles, PLAN.rate, stroke=PLAN.stroke)
        return super().look(situation)


def bench() -> SimulatedRig:
    muscle = mckibben()
    return SimulatedRig(PneumaticCircuit(), muscle, machine_for(muscle, MachineClock()))


def test_strokes_are_waited_for(tmp_path: Path) -> None:
    """Four seconds late each time: the run goes on once they have begun, and not before."""
    sim, path = bench(), tmp_path / "test.fam"
    person = ByHand()
    person.machine = sim.machine
    person.acts = [
        (lambda now: now.phase == "ready" and person.since >= 82, "begin") for _ in range(2)
    ]
    attended(path, person, sim, asked=True)
    record = read_journal(path)
    for asked, began in zip(record.notes_of("set"), record.notes_of("strokes"), strict=True):
        assert began["at"] - asked["at"] == pytest.approx(3.0 + 4.0, abs=0.8)
        assert began["held"]
    sim.machine.write_log(tmp_path / "machine.csv")
    found = analyse(
        record, read_machine_log(tmp_path / "machine.csv"), rest_length=mckibben().rest_length
    )
    assert [isobar.cycles for isobar in found.characterisation.isobars] == [2, 2]


def test_what_was_recorded_of_a_repeated_block_does_not_count(tmp_path: Path) -> None:
    sim, path = bench(), tmp_path / "test.fam"
    person = Scripted((in_phase("strokes", 0, 20), "repeat"))
    attended(path, person, sim, machine=sim.machine)
    sim.machine.write_log(tmp_path / "machine.csv")
    found = analyse(
        read_journal(path), read_machine_log(tmp_path / "machine.csv"),
        rest_length=mckibben().rest_length,
    )  # fmt: skip
    assert [isobar.cycles for isobar in found.characterisation.isobars] == [2, 2]


def test_go_is_not_obeyed_before_the_pressure_is_held(tmp_path: Path) -> None:
    """So slow a controller never holds it."""
    person = Scripted((in_phase("ready", 0), "begin"), (later(2.0), "skip"))
    sim, slow = SimulatedRig(), Control.per_psi(0, 0.01)
    plan = Isobaric((60 * PSI,), 1, 0.01, 0.01, settle=0.5)
    with Rig(VirtualLink(sim), sim.calibration(), pressure_limit=110 * PSI, control=slow) as rig:
        run(rig, plan, attendant=person, asked=True)
    assert "pressure NOT held" in person.told[0]
    assert "do not start" in person.told[0]
    assert person.told[1].startswith("not yet: the pressure is not held")


def test_progress_is_reported_every_second() -> None:
    seen: list[tuple[float, float]] = []
    watcher = Watcher(lambda done, planned: seen.append((done, planned)))
    for k in range(100):
        watcher.look(Situation("strokes", 0, 0, 1, 1, 0.0, 0.0, 0.05 * k, 5 - 0.05 * k, None))
    assert [done for done, _ in seen] == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])
    assert {planned for _, planned in seen} == {5.0}


def test_a_camera_is_a_command(tmp_path: Path) -> None:
    program = f"{sys.executable} -c \"import sys; open(sys.argv[1], 'x')\" {tmp_path}/{{name}}.jpg"
    camera = CameraCommand(program)
    for name in ("block00-00000", "block00-00001"):
        camera(name)
    assert camera.failures() == {}
    camera("block00-00001")
    assert camera.failures() == {"block00-00001": "exit code 1"}
    assert {path.name for path in tmp_path.iterdir()} == {"block00-00000.jpg", "block00-00001.jpg"}


@pytest.mark.parametrize(
    ("command", "words"),
    [("take-it", "needs {name}"), ("no-such-program {name}", "not on this computer's path")],
)
def test_a_camera_that_cannot_be_is_refused(command: str, words: str) -> None:
    with pytest.raises(RigError, match=words):
        CameraCommand(command)
