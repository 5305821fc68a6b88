"""Run and record attended tests, and step the pump to measure its feed-forward."""

import contextlib
import datetime
import json
import math
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from .calibration import Calibration, FeedForward, fit_feed_forward, pressure_text, read_calibration
from .control import HELD, LOOK, Rig, RigSettings
from .errors import RigError
from .journal import Journal, Record, read_journal, write_summary
from .link import AbstractLink, mean_counts
from .plan import Isobaric, PlanFile
from .protocol import Sample

JOURNAL = "test.fam"  # name of a test's journal in its folder
LOAD_TIME = 60.0  # s within which the load must show the first stroke
STEP_SETTLE, STEP_MEAN = 3.0, 1.0  # s of settling after a pump step, and of averaging
_SECOND = 20  # looks

# An attendant's request: none; strokes have begun, or continue; hold the pressure; skip this block;
# repeat it.
Request = Literal["", "begin", "pause", "skip", "repeat"]
# Event that marks the start of the strokes: the prompt, the attendant's word, or a change of the load.
Start = Literal["at-once", "asked", "load"]
# Phase of a run: waiting for the pressure, for the first stroke, for the last one, or for the attendant.
Phase = Literal["settling", "ready", "strokes", "paused"]


class Situation(NamedTuple):
    """State of a run when the attendant is polled.

    Attributes:
        phase: current phase.
        block: number of the current block.
        last_block: number of the last block.
        cycle: number of the current stroke, from 1; 0 before the first.
        cycles: strokes in this block.
        set_point: set pressure [Pa gauge].
        done: elapsed time of the plan [s].
        left: remaining time of the plan [s], neglecting the operator's delays.
        newest: newest record of the device.
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
    """An attendant that does nothing; subclasses display progress and make requests."""

    def tell(self, text: str) -> None:
        """Show a message to the operator."""

    def look(self, situation: Situation) -> Request:  # noqa: ARG002 -- for subclasses
        """Return the attendant's request; called about twenty times a second."""
        return ""


def prepare(test: PlanFile, folder: str | Path, *, resume: bool = False) -> tuple[Calibration, int]:
    """Validate a test before the port is opened; nothing is written.

    Args:
        test: contents of the plan file.
        folder: folder of the journal.
        resume: True to resume the existing journal.

    Returns:
        The calibration, and the first block to run.

    Raises:
        RigError: the calibration is missing, a limit or pressure is invalid, or the journal belongs to
            another test.
    """
    if test.calibration is None:
        raise RigError("[rig] must specify a calibration file: calibration = 'calibration.toml'")
    calibration, journal = read_calibration(test.calibration), Path(folder) / JOURNAL
    first = _resumed_block(read_journal(journal), test, calibration) if resume else 0
    _check(test, calibration, first)
    return calibration, first


def _check(test: PlanFile, calibration: Calibration, first_block: int) -> None:
    """Validate a test.

    A water circuit needs a feed-forward that depends on the pressure: regardless of the set pressure, a
    pump at half speed holds a fixed pressure, which is 39 psi in the simulated circuit.
    """
    if test.circuit == "water" and not any(calibration.feed_forward.coefficients[1:]):
        raise RigError(
            "a water circuit requires a feed-forward that rises with the pressure: measure it with "
            "`famjax rig calibrate-pump`"
        )
    test.settings.commands(calibration)
    check_plan(test.plan, calibration, test.settings, first_block)


def _resumed_block(record: Record, test: PlanFile, calibration: Calibration) -> int:
    """Return the first block to run when a journal is resumed."""
    now = {"plan": repr(test.plan), **test.settings.as_note(calibration)}
    begun = {k: v for kind in ("plan", "rig") for n in record.notes_of(kind) for k, v in n.items()}
    wanted = json.loads(json.dumps(now))  # as a journal holds it
    if "plan" not in begun or "pressure_limit_Pa" not in begun:
        raise RigError(
            f"{record.path} cannot be resumed: its note of the plan or the settings is damaged or missing. "
            "Record to another folder"
        )
    apart = [name for name, value in wanted.items() if begun.get(name) != value]
    if apart:
        raise RigError(
            f"{record.path} cannot be resumed: it was started with a different {', '.join(apart)}. "
            "Restore the original settings, or record to another folder"
        )
    block = max((note["block"] + 1 for note in record.notes_of("done")), default=0)
    if block >= len(test.plan.pressures):
        raise RigError(f"{record.path} is complete: there is nothing to resume")
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
    """Run a test over a real or virtual link, record it, and write its summary.

    If the test is refused, no journal is left behind.

    Args:
        test: plan, limits and gains.
        link: link to the device.
        calibration: sensor calibration.
        path: path of the journal.
        append: True to continue the existing journal.
        began: start time of a simulated test; None uses the current time.
        first_block: see `run`.
        attendant: see `run`.
        **more: arguments `machine` and `start`, passed to `run`.

    Raises:
        RigError: see `Journal`, `Rig` and `run`.
        RigFault: the test was stopped; the rig has vented.
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
        if not entered:  # the device refused the test
            path.unlink()
        raise
    finally:
        if entered:
            with contextlib.suppress(OSError):  # a full disk, already reported by the journal
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

    The pressure is held during pauses and while waiting for the first stroke.

    Args:
        rig: rig in its `with` block; it vents on exit.
        plan: plan to run.
        machine: test machine with `busy` and `start`, such as `TestMachine`; None waits for the duration
            of the strokes.
        first_block: first block to run.
        attendant: receives the prompts and is polled during the run.
        start: event that marks the start of the strokes if `machine` is None: the prompt, the attendant's
            word, or a change in the load within `LOAD_TIME`.

    Raises:
        RigError: see `check_plan`; raised before anything is started.
        RigFault: the test was stopped.
    """
    check_plan(plan, rig.calibration, rig.settings, first_block)
    seconds = plan.duration(first_block)
    rig.note("plan", plan=repr(plan), first_block=first_block, seconds=seconds)
    _Run(rig, plan, machine, attendant or Attendant(), start).blocks(first_block)
    rig.stop()


def check_plan(
    plan: Isobaric, calibration: Calibration, settings: RigSettings, first_block: int = 0
) -> None:
    """Check that the rig can run a plan, before anything is started.

    Raises:
        RigError: a set pressure is at or above the rig's limit, or outside the range of the feed-forward.
    """
    pressures = plan.pressures[first_block:]
    if (highest := max(pressures, default=0.0)) >= settings.pressure_limit:
        set_, limit = (pressure_text(P, settings.unit) for P in (highest, settings.pressure_limit))
        raise RigError(
            f"the plan sets {set_}, but the limit is {limit}: lower the pressure, or raise the limit if "
            "the muscle and the circuit are rated for it"
        )
    for pressure in pressures:
        calibration.feed_forward.output(pressure, settings.unit)


def sync_seconds(block: int) -> float:
    """Return the duration of the sync pulse at the first stroke of a block [s].

    Sixteen consecutive blocks have distinct durations, so even a log with missing pulses can be aligned.
    Each duration is an odd number of 10 ms records, so the two edges fall at different positions between
    the rows of a 50 Hz log.

    >>> sync_seconds(0), sync_seconds(3)
    (0.51, 1.29)
    """
    return 0.51 + 0.26 * (block % 16)


class _LeftError(Exception):
    """Raised to leave a block early, after the word "skip" or "repeat"."""


class _Run:
    """One run of a plan; see `run` for the arguments."""

    def __init__(
        self, rig: Rig, plan: Isobaric, machine: Any, attendant: Attendant, start: Start
    ) -> None:
        self._rig, self._plan, self._machine = rig, plan, machine
        self._attendant, self._start = attendant, start
        self._block, self._done, self._seconds, self._paused = 0, 0.0, 0.0, False
        self._pressures: deque[float] = deque(maxlen=_SECOND)
        self._loads: deque[float] = deque(maxlen=2 * _SECOND)

    def blocks(self, first: int) -> None:
        """Run all blocks; a block may be skipped or repeated."""
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
        """Return the pressure [Pa] at which the ramp starts, within the range of the feed-forward."""
        last, known = self._rig.set_point, self._rig.calibration.feed_forward.pressure_range[0]
        return max(0.0 if math.isnan(last) else last, known)

    def _strokes(self) -> None:
        """Wait until the test machine has finished, or for the duration of the strokes."""
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
        """Prompt for the strokes, and hold the pressure until they begin."""
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
                tell("not yet: the set pressure has not been reached; wait, or type stop")
            left -= 0 if self._paused else LOOK
            if self._start == "load" and left <= 0:
                rig.fault(
                    f"the load has not changed for {LOAD_TIME:.0f} s: the strokes have not begun, or the "
                    "load cell is dead; the device will now vent"
                )

    def _load_left(self, before: list[float]) -> bool:
        """Return True if the latest load lies outside its earlier range by more than the range's width."""
        now = math.fsum(list(self._loads)[-5:]) / 5
        spread = max(before) - min(before)
        return not min(before) - spread <= now <= max(before) + spread

    @property
    def _held(self) -> bool:
        """True if the mean pressure of the last second equals the set pressure."""
        seen = self._pressures or [self._rig.pressure]
        return abs(math.fsum(seen) / len(seen) - self._rig.set_point) <= HELD

    def _look(self, phase: Phase, seconds: float, cycle: int = 0) -> Request:
        """Wait for at most one polling interval, and handle the attendant's request.

        The plan's clock stops during pauses and while waiting for the first stroke.

        Raises:
            _LeftError: the attendant skips or repeats the block.
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
            held = "paused, pressure held; stop the strokes"
            self._attendant.tell(f"block {self._block}: {held if self._paused else 'continues'}")
        return asked

    def _start_strokes(self) -> str:
        """Return the prompt for the operator of the test machine, with the measured pressure."""
        rig = self._rig
        pressures = rig.pressure, rig.set_point
        measured, wanted = (pressure_text(P, rig.settings.unit) for P in pressures)
        held, what = "NOT held", "do not start the strokes; wait, or stop the run"
        if self._held:
            held, what = "held", "start the strokes"
        return f"block {self._block}: pressure {held}, {measured} of {wanted}: {what}"


def _seq(rig: Rig) -> int:
    """Return the number of the newest record, -1 before the first."""
    return rig.link.newest.seq if rig.link.newest else -1


def calibrate_feed_forward(
    rig: Rig, outputs: Sequence[int], tell: Callable[[int, float], None] | None = None
) -> FeedForward:
    """Measure the feed-forward by stepping the pump or valve with the controller off.

    Args:
        rig: rig in its `with` block.
        outputs: output steps [counts, 0..255]; with steps up and down, hysteresis appears as scatter.
        tell: called after each step with output [counts] and pressure [Pa].

    Returns:
        Cubic fit of the steps, with its scatter.

    Raises:
        RigError: the pressure does not rise with the output.
        RigFault: the test was stopped, for example at the pressure limit.
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
