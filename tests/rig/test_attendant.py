"""A run that somebody attends: the plan stands while paused, strokes are waited for."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from benches import PSI, journal_of, opened, vented

from famjax.app.isobaric import analyse, table
from famjax.app.simulation import Watcher
from famjax.plant import LinearMcKibben, PneumaticCircuit
from fitting.records import read_machine_log
from rig.cli import CameraCommand
from rig.control import Control
from rig.device import Device
from rig.errors import RigError, RigFault
from rig.execution import Attendant, Request, Situation, Start, run
from rig.journal import audit, read_journal
from rig.plan import Isobaric
from rig.simulation import MachineClock, SimulatedRig, machine_for

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
    with journal_of(path, sim) as journal, opened(sim, journal, unit="psi") as rig:
        run(rig, PLAN, attendant=attendant, **options)
    assert vented(sim)
    return sim


def in_phase(phase: str, block: int) -> Callable[[Situation], bool]:
    return lambda now: now.phase == phase and now.block == block


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
        assert text.endswith(
            f"of {20 + 20 * block} psi: start the strokes: 2 of 10 mm at 2 mm/s, 20 s"
        )
    strokes = [now for now in person.seen if now.phase == "strokes"]
    assert sorted({(now.block, now.cycle) for now in strokes}) == [(0, 1), (0, 2), (1, 1), (1, 2)]
    assert all(now.cycles == 2 and now.last_block == 1 for now in strokes)
    assert [now.done + now.left for now in person.seen] == pytest.approx([46.0] * len(person.seen))
    assert np.diff([now.done for now in person.seen]).min() >= 0
    assert all(abs(now.pressure - now.set_point) < 2 * PSI for now in strokes)


@pytest.mark.parametrize("word", ["pause", "begin"])
def test_a_paused_plan_stands_with_its_pressure_held(word: Request, tmp_path: Path) -> None:
    person = Scripted((in_phase("settling", 1), "pause"), (later(7.0), word))
    attended(tmp_path / "test.fam", person)
    record = read_journal(tmp_path / "test.fam")
    lasted = record.notes_of("end")[0]["at"] - record.notes_of("plan")[0]["at"]
    assert lasted == pytest.approx(46.0 + 7.0, abs=1.5)
    begin, end = record.notes_of("paused")[0]["at"], record.notes_of("went_on")[0]["at"]
    assert end - begin == pytest.approx(7.0, abs=0.3)
    columns = table(record)
    held = (columns["time_s"] > end - 3) & (columns["time_s"] < end)
    assert np.abs(columns["pressure_Pa"][held] - 40 * PSI).max() < 2 * PSI
    assert np.ptp([now.done for now in person.seen if now.phase == "paused"]) == 0
    assert audit(record).sound


class ByHand(Scripted):
    """Starts the machine four seconds after it was asked to, as a person does."""

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


@pytest.mark.parametrize("start", ["asked", "load"])
def test_strokes_are_waited_for(start: Start, tmp_path: Path) -> None:
    """Four seconds late each time: the run goes on once they have begun, and not before."""
    muscle, path, person = LinearMcKibben(), tmp_path / "test.fam", ByHand()
    sim = SimulatedRig(PneumaticCircuit(), muscle, machine_for(muscle, MachineClock()))
    person.machine = sim.machine
    if start == "asked":
        person.acts = [
            (lambda now: now.phase == "ready" and person.since >= 82, "begin") for _ in range(2)
        ]
    attended(path, person, sim, start=start)
    record = read_journal(path)
    for asked, began in zip(record.notes_of("set"), record.notes_of("strokes"), strict=True):
        assert began["at"] - asked["at"] == pytest.approx(3.0 + 4.0, abs=0.8)
        assert began["held"]
    sim.machine.write_log(tmp_path / "machine.csv")
    log = read_machine_log(tmp_path / "machine.csv")
    found = analyse(record, log, rest_length=float(muscle.rest_length))
    assert [isobar.cycles for isobar in found.characterisation.isobars] == [2, 2]


def test_a_load_that_never_moves_ends_the_wait_after_60_s(tmp_path: Path) -> None:
    """A load cell that has died, or nobody at the machine."""

    class Dead(Device):
        def tick(self, pressure_counts: int, force_counts: int) -> None:
            super().tick(pressure_counts, 141)

    for sim in (SimulatedRig(), SimulatedRig(device=Dead())):
        with pytest.raises(RigFault, match=r"has not moved for 60 s.*load cell is dead"):
            attended(tmp_path / f"{id(sim)}.fam", Scripted(), sim, start="load")
        assert vented(sim)
        (note,) = read_journal(tmp_path / f"{id(sim)}.fam").notes_of("fault")
        (set_,) = read_journal(tmp_path / f"{id(sim)}.fam").notes_of("set")
        assert note["at"] - set_["at"] == pytest.approx(3 + 60, abs=3)


def test_begin_is_not_obeyed_before_the_pressure_is_held() -> None:
    """So slow a controller never holds it."""

    def leave(_: Situation) -> bool:
        raise KeyboardInterrupt

    person = Scripted((in_phase("ready", 0), "begin"), (later(2.0), ""), (leave, ""))
    sim, slow = SimulatedRig(), Control.per_psi(0, 0.01)
    plan = Isobaric((60 * PSI,), 1, 0.01, 0.01, settle=0.5)
    with pytest.raises(KeyboardInterrupt), opened(sim, control=slow) as rig:
        run(rig, plan, attendant=person, start="asked")
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
    for command, words in (
        ("take-it", "needs {name}"),
        ("no-such {name}", "not on this computer's"),
    ):
        with pytest.raises(RigError, match=words):
            CameraCommand(command)
