"""A test carried out, recorded, and steered by who attends it; the pump stepped for its feed-forward."""

import datetime
import json
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from famjax.units import PSI

from .calibration import Calibration, FeedForward, fit_feed_forward, read_calibration
from .control import HELD, LOOK, Rig
from .errors import RigError
from .journal import Journal, Record, read_journal
from .link import AbstractLink, mean_counts
from .plan import Plan, PlanFile, Step, duration, next_block, seconds_of
from .protocol import Sample

JOURNAL = "test.fam"  # name of a test's journal in its folder
_SECOND = 20  # looks

# An attendant's request: none; strokes are under way, or go on; pause with the pressure held, or go
# on; skip this block; repeat it.
Request = Literal["", "begin", "pause", "skip", "repeat"]
# What a run waits for: the pressure, the first stroke, the last one, the attendant.
Phase = Literal["settling", "ready", "strokes", "paused"]


class Situation(NamedTuple):
    """A run at one look.

    Attributes:
        phase: what it waits for.
        block: of the plan.
        last_block: of the plan.
        cycle: stroke there and back under way, from 1; 0 before the first.
        cycles: of the block.
        pressure: measured [Pa gauge].
        set_point: set pressure [Pa gauge].
        done: time of the plan that has passed [s].
        left: time of the plan that is left [s], neglecting the time that the operator takes.
        newest: the device's newest record.
    """

    phase: Phase
    block: int
    last_block: int
    cycle: int
    cycles: int
    pressure: float
    set_point: float
    done: float
    left: float
    newest: Sample | None


class Attendant:
    """An attendant that requests nothing; subclasses display and steer."""

    def tell(self, text: str) -> None:
        """An instruction to the operator."""

    def look(self, situation: Situation) -> Request:  # noqa: ARG002 -- for subclasses
        """Called about twenty times a second; returns a request."""
        return ""


def prepare(
    test: PlanFile, folder: str | Path, *, resume: bool = False, camera: object = None
) -> tuple[Calibration, int]:
    """All that can be refused before a port is opened; nothing is written.

    Args:
        test: from its file.
        folder: of the journal.
        resume: continue the journal there.
        camera: takes the photographs of the plan.

    Returns:
        The calibration, and the block with which the test begins.

    Raises:
        RigError: the test names no calibration, or photographs and there is no camera; the limits
            or a pressure cannot be; the journal there is of another test.
    """
    if test.calibration is None:
        raise RigError("[rig] must name a calibration, as in calibration = 'calibration.toml'")
    if (every := test.plan.photograph_every) and camera is None:
        raise RigError(
            f"[plan]: photograph_every_s = {every:g} needs a camera: --camera with the command that "
            "takes a photograph, or leave the key out and trigger the camera yourself"
        )
    calibration, journal = read_calibration(test.calibration), Path(folder) / JOURNAL
    first = _resumed_block(read_journal(journal), test, calibration) if resume else 0
    _check(test, calibration, first)
    return calibration, first


def _check(test: PlanFile, calibration: Calibration, first_block: int) -> None:
    """Refuse what cannot be.

    A water circuit needs a feed-forward that depends on the pressure: a pump at half speed holds some
    pressure of its own, whatever is set, 39 psi in the simulated circuit.
    """
    output, *higher = calibration.feed_forward.coefficients
    if test.circuit == "water" and not any(higher):
        raise RigError(
            f"a water circuit needs a feed-forward that rises with the pressure, got {output:g} counts "
            "at every pressure, the bias of an air valve: the pump would raise a pressure that is not "
            "set. Step the pump against the needle valve: `famjax rig calibrate-pump`"
        )
    test.settings.commands(calibration)
    check_plan(test.plan, calibration, test.pressure_limit, first_block)


def _resumed_block(record: Record, test: PlanFile, calibration: Calibration) -> int:
    """The block with which a test goes on in the journal that it began."""
    now = {"plan": repr(test.plan), **test.settings.as_note(calibration)}
    begun = {k: v for kind in ("plan", "rig") for n in record.notes_of(kind) for k, v in n.items()}
    wanted = json.loads(json.dumps(now))  # as a journal holds it
    apart = [name for name, value in wanted.items() if begun.get(name, value) != value]
    if apart:
        raise RigError(
            f"{record.path} cannot be resumed with another test: it was begun with another "
            f"{', '.join(apart)}. Restore what it was begun with, or record into another folder"
        )
    block = next_block(record.notes)
    if block >= len(test.plan.pressures):
        raise RigError(f"{record.path} is complete: nothing is left to resume")
    return block


def rig_of(test: PlanFile, link: AbstractLink, calibration: Calibration, **more: Any) -> Rig:
    """The rig of a test, still to be entered; `journal` and `camera` as for `Rig`."""
    limits = {"pressure_limit": test.pressure_limit, "jump_limit": test.jump_limit}
    return Rig(link, calibration, control=test.control, guards=test.guards, **limits, **more)


def record_test(
    test: PlanFile,
    link: AbstractLink,
    calibration: Calibration,
    path: Path,
    *,
    machine: Any = None,
    first_block: int = 0,
    append: bool = False,
    meta: Mapping[str, str] | None = None,
    attendant: Attendant | None = None,
    asked: bool = False,
    camera: Callable[[str], None] | None = None,
    began: datetime.datetime | None = None,
) -> None:
    """Carry out a test over a link, real or virtual, and record it.

    A test that is refused leaves no journal behind.

    Args:
        test: plan, limits and gains.
        link: to the device.
        calibration: of its sensors.
        path: of the journal.
        machine: as for `run`.
        first_block: as for `run`.
        append: continue the existing journal.
        meta: further entries of the journal.
        attendant: as for `run`.
        asked: as for `run`.
        camera: called with a name to take a photograph, or None.
        began: date of a simulated test; now if None.

    Raises:
        RigError: as `Journal`, `Rig` and `run`.
        RigFault: the test had to stop; the rig is vented.
    """
    _check(test, calibration, first_block)
    empty = False
    try:
        with Journal(
            path, lambda: link.now, append=append,
            plan_seconds=duration(test.plan, first_block), began=began,
        ) as journal:  # fmt: skip
            empty = not append
            if meta:
                journal.note("meta", entries=dict(meta))
            with rig_of(test, link, calibration, journal=journal, camera=camera) as rig:
                empty = False
                for sentence in rig.unseen:
                    (attendant or Attendant()).tell(f"note: {sentence}")
                run(rig, test.plan, machine=machine, first_block=first_block, attendant=attendant,
                    asked=asked)  # fmt: skip
    except RigError:
        if empty:  # the device refused the test: nothing has run
            path.unlink()
        raise


def run(
    rig: Rig,
    plan: Plan,
    *,
    machine: Any = None,
    first_block: int = 0,
    attendant: Attendant | None = None,
    asked: bool = False,
) -> None:
    """Carry out a plan from a block on and stop the rig.

    The pressure is held while a run is paused, and while it waits for the first stroke. A block
    that the attendant leaves or repeats is noted, and no analysis takes what was recorded of it.

    Args:
        rig: entered, so that it vents whatever happens.
        plan: what to do.
        machine: makes the strokes, as `TestMachine` does, with `busy` and `start`; without one the plan
            waits for as long as they last.
        first_block: where to begin; `next_block` of a journal's notes resumes it.
        attendant: gets the instruction to start the strokes, sees the rig at every look, may steer.
        asked: without a machine, wait until the attendant says that the strokes of a block have begun.

    Raises:
        RigError: as `check_plan`; nothing has been started then.
        RigFault: the test had to stop.
    """
    check_plan(plan, rig.calibration, rig.settings.pressure_limit, first_block)
    rig.note("plan", plan=repr(plan), first_block=first_block, seconds=duration(plan, first_block))
    carried_out = _Run(rig, plan, machine, attendant or Attendant(), asked)
    following: int | None = first_block
    while following is not None:
        following = carried_out.blocks(following)
    rig.stop()


def check_plan(
    plan: Plan, calibration: Calibration, pressure_limit: float, first_block: int = 0
) -> None:
    """Refuse a plan that a rig cannot carry out, before anything is started.

    Raises:
        RigError: a set pressure of the plan is at or above the rig's limit [Pa], or one that the
            feed-forward does not know.
    """
    pressures = [step[1] for step in plan.steps(first_block) if step[0] == "set"]
    if (highest := max(pressures, default=0.0)) >= pressure_limit:
        raise RigError(
            f"the plan sets {highest:.0f} Pa, the limit is {pressure_limit:.0f} Pa; lower the one "
            "or, if muscle and circuit are rated for it, raise the other"
        )
    for pressure in pressures:
        calibration.feed_forward.output(pressure)


def sync_seconds(block: int) -> float:
    """How long the sync pin is high at the first stroke of a block [s].

    Each of sixteen blocks has its own length, so that a log that lacks some pulses still matches
    in one way only; each is an odd number of records of 10 ms, so that in a log of 50 rows a second
    both edges do not fall alike between two rows.

    >>> sync_seconds(0), sync_seconds(3)
    (0.51, 1.29)
    """
    return 0.51 + 0.26 * (block % 16)


class _BlockLeft(Exception):  # noqa: N818 -- no error: what ends the steps of a block
    """The attendant leaves this block, and goes on with another, the first argument."""


class _Run:
    """One run of a plan; arguments as for `run`."""

    def __init__(
        self, rig: Rig, plan: Plan, machine: Any, attendant: Attendant, asked: bool
    ) -> None:
        self._rig, self._plan, self._machine = rig, plan, machine
        self._attendant, self._asked = attendant, asked
        self._last = max((step[1] for step in plan.steps() if step[0] == "block"), default=0)
        self._block, self._paused = 0, False
        self._done = self._left = 0.0
        self._pressures: deque[float] = deque(maxlen=_SECOND)

    def blocks(self, first: int) -> int | None:
        """The steps of a block and of those behind it; the block to go back or on to, if any."""
        self._left = duration(self._plan, first)
        try:
            for step in self._plan.steps(first):
                left = self._left - seconds_of(step)
                self._carry_out(step)
                self._left = left
        except _BlockLeft as left:
            return left.args[0]
        return None

    def _carry_out(self, step: Step) -> None:
        rig = self._rig
        match step:
            case ("block", block, pressure):
                self._block = block
                rig.note("block", block=block, pressure_Pa=pressure)
            case ("set", pressure):
                rig.set_pressure(pressure)
            case ("wait", seconds):
                end = self._done + seconds
                while self._done < end - 1e-9:
                    self._look("settling", end - self._done)
            case ("strokes", *_):
                self._strokes(step)
            case ("done", block):
                rig.note("done", block=block)
            case _:
                raise RigError(f"unknown step {step!r} of a plan")

    def _strokes(self, step: Step) -> None:
        """Until the machine is done, or for as long as its strokes last, with photographs."""
        rig, machine = self._rig, self._machine
        _, block, cycles, seconds, stroke, rate, every = step
        self._wait_for_the_first(step)
        rig.note(
            "strokes", block=block, cycles=cycles, seconds=seconds, stroke_m=stroke,
            rate_m_per_s=rate, pressure_Pa=rig.pressure, held=self._held,
        )  # fmt: skip
        rig.sync(sync_seconds(block))
        if machine is not None:
            machine.start(cycles, rate, stroke=stroke)
        begin, photographs = self._done, 0
        while True:
            passed = self._done - begin
            if every and passed >= photographs * every - 1e-9:
                rig.trigger(f"block{block:02d}-{photographs:05d}")
                photographs += 1
            if (not machine.busy) if machine is not None else passed >= seconds - 1e-9:
                break
            ends = [LOOK if machine is not None else seconds - passed]
            if every:
                ends.append(photographs * every - passed)
            cycle = min(1 + int(passed / seconds * cycles), cycles)
            self._look("strokes", max(min(ends), 1e-3), cycle, cycles)
        rig.note("strokes_end", block=block)

    def _wait_for_the_first(self, step: Step) -> None:
        """Ask for the strokes, and hold the pressure until they have begun."""
        self._attendant.tell(self._start_strokes(step))
        if self._machine is not None or not self._asked:
            return
        held = self._held  # once: the first stroke itself may disturb the pressure
        while (asked := self._look("ready", LOOK, 0, step[2])) != "begin" or not held:
            if not held and self._held:
                held = True
                self._attendant.tell(self._start_strokes(step))
            elif asked == "begin":
                self._attendant.tell("not yet: the pressure is not held; wait, skip or stop")

    @property
    def _held(self) -> bool:
        """Whether the pressure of the last second is the set one."""
        seen = self._pressures or [self._rig.pressure]
        return abs(math.fsum(seen) / len(seen) - self._rig.set_point) <= HELD

    def _look(self, phase: Phase, seconds: float, cycle: int = 0, cycles: int = 0) -> Request:
        """Wait for a look at most and do what the attendant asks.

        The plan stands while it is paused or waits for the first stroke.
        """
        rig, before = self._rig, self._rig.link.now
        rig.wait(min(seconds, LOOK))
        self._pressures.append(rig.pressure)
        if phase != "ready" and not self._paused:
            passed = rig.link.now - before
            self._done, self._left = self._done + passed, self._left - passed
        asked = self._attendant.look(
            Situation(
                "paused" if self._paused else phase, self._block, self._last, cycle, cycles,
                rig.pressure, rig.set_point, self._done, max(self._left, 0.0), rig.link.newest,
            )
        )  # fmt: skip
        if asked == "begin" and self._paused:
            asked = "pause"
        self._obey(asked)
        return asked

    def _obey(self, asked: Request) -> None:
        block, tell = self._block, self._attendant.tell
        if asked == "pause":
            self._paused = not self._paused
            self._rig.note("paused" if self._paused else "went_on", block=block)
            held = "paused, the pressure is held; stop the strokes"
            tell(f"block {block}: {held if self._paused else 'goes on'}")
        elif asked in ("skip", "repeat"):
            self._paused = False
            what = "skipped" if asked == "skip" else "repeated"
            self._rig.note(what, block=block)
            tell(f"block {block} is {what}: stop the strokes")
            raise _BlockLeft(block + (asked == "skip"))

    def _start_strokes(self, step: Step) -> str:
        """The instruction to the person at the test machine, with the measured pressure."""
        _, block, cycles, seconds, stroke, rate, _ = step
        measured, wanted, held = self._rig.pressure, self._rig.set_point, self._held
        return (
            f"block {block}: pressure {'held' if held else 'NOT held'}, {measured / 1e3:.4g} kPa "
            f"({measured / PSI:.4g} psi) of {wanted / 1e3:.4g} kPa ({wanted / PSI:.4g} psi): "
            f"{'start the strokes' if held else 'do not start, or stop the run'}: {cycles} of "
            f"{stroke * 1e3:.4g} mm at {rate * 1e3:.4g} mm/s, {seconds:.0f} s"
        )


def calibrate_feed_forward(
    rig: Rig,
    outputs: Sequence[int],
    *,
    settle: float = 3.0,
    average: float = 1.0,
    tell: Callable[[int, float], None] | None = None,
) -> FeedForward:
    """The feed-forward from steps of the pump or valve, the controller off.

    Args:
        rig: entered.
        outputs: steps [counts, 0..255]; going up and down again shows hysteresis as scatter.
        settle: time after each step [s].
        average: time of each mean [s].
        tell: called after each step with its output [counts] and pressure [Pa].

    Returns:
        The cubic through the steps, with its error.

    Raises:
        RigError: the pressure does not rise with the output.
        RigFault: the test had to stop, as where a step reaches the pressure limit.
    """
    pressures = []
    for output in outputs:
        rig.manual(int(output))
        rig.wait(settle)
        counts, _ = mean_counts(rig.link, average, rig.wait)
        pressures.append(float(rig.calibration.pressure.value(counts)))
        rig.note("step", output=int(output), pressure_Pa=pressures[-1])
        if tell is not None:
            tell(int(output), pressures[-1])
    rig.stop()
    return fit_feed_forward(pressures, outputs)
