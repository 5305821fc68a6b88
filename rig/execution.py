"""Tests: carried out, recorded and steered by an attendant; steps of the pump for its feed-forward."""

import contextlib
import datetime
import json
import math
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from .calibration import (
    Calibration,
    FeedForward,
    fit_feed_forward,
    pressure_text,
    read_calibration,
)
from .control import HELD, LOOK, Rig, RigSettings
from .errors import RigError
from .journal import Journal, Record, read_journal, write_summary
from .link import AbstractLink, mean_counts
from .plan import Isobaric, PlanFile
from .protocol import Sample

JOURNAL = "test.fam"  # name of a test's journal in its folder
LOAD_TIME = 60.0  # s within which the load has to show the first stroke
STEP_SETTLE, STEP_MEAN = 3.0, 1.0  # s after a step of the pump, and of the mean after that
_SECOND = 20  # looks

# An attendant's request: none; strokes are under way, or the run goes on; hold the pressure; leave this
# block; do this block again.
Request = Literal["", "begin", "pause", "skip", "repeat"]
# When strokes count as begun: when they are asked for, when the attendant says so, when the load moves.
Start = Literal["at-once", "asked", "load"]
# What a run waits for: the pressure, the first stroke, the last one, the attendant.
Phase = Literal["settling", "ready", "strokes", "paused"]


class Situation(NamedTuple):
    """State of a run at one look.

    Attributes:
        phase: what it waits for.
        block: of the plan.
        last_block: of the plan.
        cycle: stroke there and back under way, from 1; 0 before the first.
        cycles: of the block.
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
    set_point: float
    done: float
    left: float
    newest: Sample | None


class Attendant:
    """An attendant that requests nothing; subclasses display and steer."""

    def tell(self, text: str) -> None:
        """Tell the operator something."""

    def look(self, situation: Situation) -> Request:  # noqa: ARG002 -- for subclasses
        """Called about twenty times a second; returns a request."""
        return ""


def prepare(test: PlanFile, folder: str | Path, *, resume: bool = False) -> tuple[Calibration, int]:
    """Check everything that can be refused before a port is opened; nothing is written.

    Args:
        test: from its file.
        folder: of the journal.
        resume: continue the journal there.

    Returns:
        The calibration, and the block with which the test begins.

    Raises:
        RigError: the test names no calibration; the limits or a pressure cannot be; the journal
            there is of another test.
    """
    if test.calibration is None:
        raise RigError("[rig] must name a calibration, as in calibration = 'calibration.toml'")
    calibration, journal = read_calibration(test.calibration), Path(folder) / JOURNAL
    first = _resumed_block(read_journal(journal), test, calibration) if resume else 0
    _check(test, calibration, first)
    return calibration, first


def _check(test: PlanFile, calibration: Calibration, first_block: int) -> None:
    """Refuse what cannot be.

    A water circuit needs a feed-forward that depends on the pressure: a pump at half speed holds some
    pressure of its own, whatever is set, 39 psi in the simulated circuit.
    """
    if test.circuit == "water" and not any(calibration.feed_forward.coefficients[1:]):
        raise RigError(
            "a water circuit needs a feed-forward that rises with the pressure: step the pump by "
            "`famjax rig calibrate-pump`"
        )
    test.settings.commands(calibration)
    check_plan(test.plan, calibration, test.settings, first_block)


def _resumed_block(record: Record, test: PlanFile, calibration: Calibration) -> int:
    """The block with which a test goes on in the journal that it began."""
    now = {"plan": repr(test.plan), **test.settings.as_note(calibration)}
    begun = {k: v for kind in ("plan", "rig") for n in record.notes_of(kind) for k, v in n.items()}
    wanted = json.loads(json.dumps(now))  # as a journal holds it
    apart = [name for name, value in wanted.items() if begun.get(name, value) != value]
    if apart:
        raise RigError(
            f"{record.path} cannot be resumed: it was begun with another {', '.join(apart)}. Restore "
            "what it was begun with, or record into another folder"
        )
    block = max((note["block"] + 1 for note in record.notes_of("done")), default=0)
    if block >= len(test.plan.pressures):
        raise RigError(f"{record.path} is complete: nothing is left to resume")
    return block


def record_test(
    test: PlanFile,
    link: AbstractLink,
    calibration: Calibration,
    path: Path,
    *,
    append: bool = False,
    began: datetime.datetime | None = None,
    first_block: int = 0,
    attendant: Attendant | None = None,
    **more: Any,
) -> None:
    """Carry out a test over a link, real or virtual, record it, and write its summary beside the journal.

    A test that is refused leaves no journal behind.

    Args:
        test: plan, limits and gains.
        link: to the device.
        calibration: of its sensors.
        path: of the journal.
        append: continue the existing journal.
        began: date of a simulated test; now if None.
        first_block: as for `run`.
        attendant: as for `run`.
        **more: `machine` and `start` of `run`.

    Raises:
        RigError: as `Journal`, `Rig` and `run`.
        RigFault: the test had to stop; the rig is vented.
    """
    _check(test, calibration, first_block)
    attendant, seconds = attendant or Attendant(), test.plan.duration(first_block)
    entered = append
    journal = Journal(path, lambda: link.now, append=append, plan_seconds=seconds, began=began)
    try:
        with journal, Rig(link, calibration, journal=journal, **vars(test.settings)) as rig:
            entered = True
            for sentence in rig.unseen:
                attendant.tell(f"note: {sentence}")
            run(rig, test.plan, first_block=first_block, attendant=attendant, **more)
    except RigError:
        if not entered:  # the device refused the test: nothing has run
            path.unlink()
        raise
    finally:
        if entered:
            with contextlib.suppress(OSError):  # a full disk, which the journal has reported
                attendant.tell("\n".join(write_summary(path, test.unit)))


def run(
    rig: Rig,
    plan: Isobaric,
    *,
    machine: Any = None,
    first_block: int = 0,
    attendant: Attendant | None = None,
    start: Start = "at-once",
) -> None:
    """Run a plan from a given block onwards, then stop the rig.

    The pressure is held while it is paused, and while it waits for the first stroke.

    Args:
        rig: entered, so that it vents whatever happens.
        plan: what to do.
        machine: makes the strokes, as `TestMachine` does, with `busy` and `start`; without one the plan
            waits for as long as they last.
        first_block: where to begin.
        attendant: gets the instruction to start the strokes, sees the rig at every look.
        start: when the strokes of a block count as begun, without a machine: when they are asked for,
            when the attendant says so, or when the load moves, within `LOAD_TIME`.

    Raises:
        RigError: as `check_plan`; nothing has been started then.
        RigFault: the test had to stop.
    """
    check_plan(plan, rig.calibration, rig.settings, first_block)
    seconds = plan.duration(first_block)
    rig.note("plan", plan=repr(plan), first_block=first_block, seconds=seconds)
    _Run(rig, plan, machine, attendant or Attendant(), start).blocks(first_block)
    rig.stop()


def check_plan(
    plan: Isobaric, calibration: Calibration, settings: RigSettings, first_block: int = 0
) -> None:
    """Refuse a plan that a rig cannot carry out, before anything is started.

    Raises:
        RigError: a set pressure of the plan is at or above the rig's limit, or one that the
            feed-forward does not know.
    """
    pressures = plan.pressures[first_block:]
    if (highest := max(pressures, default=0.0)) >= settings.pressure_limit:
        set_, limit = (pressure_text(P, settings.unit) for P in (highest, settings.pressure_limit))
        raise RigError(
            f"the plan sets {set_}, the limit is {limit}: lower the pressure, or raise the limit if "
            "muscle and circuit are rated for it"
        )
    for pressure in pressures:
        calibration.feed_forward.output(pressure, settings.unit)


def sync_seconds(block: int) -> float:
    """How long the sync pin is high at the first stroke of a block [s].

    Each of sixteen blocks has its own length, so that a log that lacks some pulses still matches
    in one way only; each is an odd number of records of 10 ms, so that in a log of 50 rows a second
    both edges do not fall alike between two rows.

    >>> sync_seconds(0), sync_seconds(3)
    (0.51, 1.29)
    """
    return 0.51 + 0.26 * (block % 16)


class _LeftError(Exception):
    """A block is left early, by the word "skip" or "repeat"."""


class _Run:
    """One run of a plan; arguments as for `run`."""

    def __init__(
        self, rig: Rig, plan: Isobaric, machine: Any, attendant: Attendant, start: Start
    ) -> None:
        self._rig, self._plan, self._machine = rig, plan, machine
        self._attendant, self._start = attendant, start
        self._block, self._done, self._seconds, self._paused = 0, 0.0, 0.0, False
        self._pressures: deque[float] = deque(maxlen=_SECOND)
        self._loads: deque[float] = deque(maxlen=2 * _SECOND)

    def blocks(self, first: int) -> None:
        """At each pressure: set, settle, strokes; a block may be skipped or repeated."""
        plan, self._block = self._plan, first
        self._seconds = plan.duration(first)
        while self._block < len(plan.pressures):
            self._done = self._seconds - plan.duration(self._block)
            try:
                self._one(plan.pressures[self._block])
                self._rig.note("done", block=self._block)
                self._block += 1
            except _LeftError as left:
                word = str(left)
                self._rig.note(word, block=self._block)
                self._attendant.tell(f"block {self._block}: {word}")
                self._block += word == "skip"

    def _one(self, pressure: float) -> None:
        rig, plan = self._rig, self._plan
        rig.note("block", block=self._block, pressure_Pa=pressure)
        begin, before = self._done, self._begins()
        rig.set_pressure(before if plan.rise else pressure)
        while (left := begin + plan.settle - self._done) > 1e-9:
            self._look("settling", left)
            if rig.set_point != pressure:
                share, sent = min((self._done - begin) / plan.rise, 1.0), rig.link.now
                rig.set_pressure(pressure if share == 1 else before + share * (pressure - before))
                self._done += rig.link.now - sent
        self._wait_for_the_first()
        self._strokes()

    def _begins(self) -> float:
        """The set pressure [Pa] from which it rises, which the feed-forward knows."""
        last, known = self._rig.set_point, self._rig.calibration.feed_forward.pressure_range[0]
        return max(0.0 if math.isnan(last) else last, known)

    def _strokes(self) -> None:
        """Until the machine is done, or for as long as its strokes last."""
        rig, plan, machine, block = self._rig, self._plan, self._machine, self._block
        cycles, seconds = plan.cycles, plan.stroke_seconds
        rig.note(
            "strokes", block=block, cycles=cycles, seconds=seconds, stroke_m=plan.stroke,
            rate_m_per_s=plan.rate, pressure_Pa=rig.pressure, held=self._held, seq=_seq(rig),
        )  # fmt: skip
        rig.sync(sync_seconds(block))
        if machine is not None:
            machine.start(cycles, plan.rate, stroke=plan.stroke)
        begin, passed = self._done, 0.0
        while machine.busy if machine is not None else passed < seconds - 1e-9:
            cycle = min(1 + int(passed / seconds * cycles), cycles)
            self._look("strokes", LOOK if machine is not None else seconds - passed, cycle)
            passed = self._done - begin
        rig.note("strokes_end", block=block, seq=_seq(rig))

    def _wait_for_the_first(self) -> None:
        """Ask for the strokes, and hold the pressure until they have begun."""
        rig, tell = self._rig, self._attendant.tell
        tell(self._start_strokes())
        if self._machine is not None or self._start == "at-once":
            return
        left, held = LOAD_TIME, self._held  # once: the first stroke itself may disturb the pressure
        before = list(self._loads)
        while True:
            asked = self._look("ready", LOOK)
            if held and (asked == "begin" or (self._start == "load" and self._load_left(before))):
                return
            if not held and self._held:
                held, before = True, list(self._loads)
                tell(self._start_strokes())
            elif asked == "begin":
                tell("not yet: the pressure is not held; wait or stop")
            left -= 0 if self._paused else LOOK
            if self._start == "load" and left <= 0:
                rig.fault(
                    f"the load has not moved for {LOAD_TIME:.0f} s: no stroke has begun, or the load "
                    "cell is dead; the device vents"
                )

    def _load_left(self, before: list[float]) -> bool:
        """Whether the load of the last quarter of a second is beyond what it was, by its spread then."""
        now = math.fsum(list(self._loads)[-5:]) / 5
        spread = max(before) - min(before)
        return not min(before) - spread <= now <= max(before) + spread

    @property
    def _held(self) -> bool:
        """Whether the pressure of the last second is the set one."""
        seen = self._pressures or [self._rig.pressure]
        return abs(math.fsum(seen) / len(seen) - self._rig.set_point) <= HELD

    def _look(self, phase: Phase, seconds: float, cycle: int = 0) -> Request:
        """Wait for a look at most, and do what the attendant asks.

        The plan stands while it is paused or waits for the first stroke.

        Raises:
            _LeftError: the block is to be skipped or repeated.
        """
        rig, before = self._rig, self._rig.link.now
        rig.wait(min(seconds, LOOK))
        self._pressures.append(rig.pressure)
        self._loads.append(rig.force)
        if phase != "ready" and not self._paused:
            self._done += rig.link.now - before
        asked = self._attendant.look(
            Situation(
                "paused" if self._paused else phase, self._block, len(self._plan.pressures) - 1, cycle,
                self._plan.cycles, rig.set_point, self._done, max(self._seconds - self._done, 0.0),
                rig.link.newest,
            )
        )  # fmt: skip
        if asked in ("skip", "repeat"):
            self._paused = False
            raise _LeftError(asked)
        if asked == "pause" or (asked == "begin" and self._paused):
            self._paused, asked = not self._paused, "pause"
            rig.note("paused" if self._paused else "went_on", block=self._block)
            held = "paused, the pressure is held; stop the strokes"
            self._attendant.tell(f"block {self._block}: {held if self._paused else 'continues'}")
        return asked

    def _start_strokes(self) -> str:
        """The instruction to the person at the test machine, with the measured pressure."""
        rig = self._rig
        pressures = rig.pressure, rig.set_point
        measured, wanted = (pressure_text(P, rig.settings.unit) for P in pressures)
        held, what = "NOT held", "do not start, or stop the run"
        if self._held:
            held, what = "held", "start the strokes"
        return f"block {self._block}: pressure {held}, {measured} of {wanted}: {what}"


def _seq(rig: Rig) -> int:
    """Number of the newest record, -1 before the first."""
    return rig.link.newest.seq if rig.link.newest else -1


def calibrate_feed_forward(
    rig: Rig, outputs: Sequence[int], tell: Callable[[int, float], None] | None = None
) -> FeedForward:
    """Measure the feed-forward by steps of the pump or valve, with the controller off.

    Args:
        rig: entered.
        outputs: steps [counts, 0..255]; going up and down again shows hysteresis as scatter.
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
        rig.wait(STEP_SETTLE)
        counts, _ = mean_counts(rig.link, STEP_MEAN, rig.wait)
        pressures.append(float(rig.calibration.pressure.value(counts)))
        rig.note("step", output=int(output), pressure_Pa=pressures[-1])
        if tell is not None:
            tell(int(output), pressures[-1])
    rig.stop()
    return fit_feed_forward(pressures, outputs)
