"""A plan carried out on a rig, block by block, with an attendant who may steer it."""

import math
from collections import deque
from typing import Protocol

from famjax.boundary.units import UNITS

from ..calibration.sensor import READINGS
from ..calibration.whole_rig import Calibration
from ..errors import RigError
from .attendant import Attendant, LoadChange, Phase, Request, Situation, Start
from .plan import Plan, Step, duration, highest_pressure, seconds_of
from .rig import LOOK, Rig

HELD = 1 * UNITS["pressure"]["psi"]
"""How far from the set pressure [Pa] one still counts as held: three times what is measured of it."""
_PSI = UNITS["pressure"]["psi"]

_SECOND = 20  # looks
PULSES = 16
"""Lengths of the sync pulse, by block."""


class Machine(Protocol):
    """A test machine that can be started by program; a manual one needs none."""

    @property
    def busy(self) -> bool:
        """Whether strokes are under way."""
        ...

    def start(self, cycles: int, rate: float, *, stroke: float | None) -> None:
        """Begin `cycles` strokes there and back of `stroke` [m] at `rate` [m/s]."""
        ...


def run(
    rig: Rig,
    plan: Plan,
    *,
    machine: Machine | None = None,
    first_block: int = 0,
    attendant: Attendant | None = None,
    start: Start = "at once",
) -> None:
    """Carry out a plan from a block on and stop the rig.

    The pressure is held while a run is paused, and while it waits for the first stroke. A block
    that the attendant leaves or repeats is noted, and no analysis takes what was recorded of it.

    Args:
        rig: entered, so that it vents whatever happens.
        plan: what to do.
        machine: makes the strokes; without one the plan waits for as long as they last.
        first_block: where to begin; `next_block` of a journal's notes resumes it.
        attendant: gets the instruction to start the strokes, sees the rig at every look, may steer.
        start: without a machine, when the strokes of a block count as begun.

    Raises:
        RigError: as `check_plan`; nothing has been started then.
        RigFault: the test had to stop.
    """
    check_plan(plan, rig.calibration, rig.settings.pressure_limit, first_block)
    rig.note("plan", plan=repr(plan), first_block=first_block, seconds=duration(plan, first_block))
    _Run(rig, plan, machine, attendant or Attendant(), start).carry_out(first_block)
    rig.stop()


def check_plan(
    plan: Plan, calibration: Calibration, pressure_limit: float, first_block: int = 0
) -> None:
    """Refuse a plan that a rig cannot carry out, before anything is started.

    Raises:
        RigError: a set pressure of the plan is at or above the rig's limit [Pa], or one that the
            feed-forward does not know.
    """
    highest = highest_pressure(plan, first_block)
    if highest >= pressure_limit:
        raise RigError(
            f"the plan sets {highest:.0f} Pa, the limit is {pressure_limit:.0f} Pa; lower the one "
            "or, if muscle and circuit are rated for it, raise the other"
        )
    for step in plan.steps(first_block):
        if step[0] == "set":
            calibration.feed_forward.output(step[1])


def sync_seconds(block: int) -> float:
    """How long the sync pin is high at the first stroke of a block [s].

    Each of sixteen blocks has its own length, so that a log that lacks some pulses still matches
    in one way only; each is an odd number of records of 10 ms, so that in a log of 50 rows a second
    both edges do not fall alike between two rows.

    >>> sync_seconds(0), sync_seconds(3)
    (0.51, 1.29)
    """
    return 0.51 + 0.26 * (block % PULSES)


class _BlockLeft(Exception):  # noqa: N818 -- no error: what ends the steps of a block
    """The attendant leaves this block, and goes on with another."""

    def __init__(self, following: int) -> None:
        super().__init__(following)
        self.following = following


class _Run:
    """One run of a plan.

    Args:
        rig: entered.
        plan: what to do.
        machine: makes the strokes, or None.
        attendant: sees and steers.
        start: without a machine, when strokes count as begun.
    """

    def __init__(
        self, rig: Rig, plan: Plan, machine: Machine | None, attendant: Attendant, start: Start
    ) -> None:
        self._rig, self._plan, self._machine = rig, plan, machine
        self._attendant, self._start = attendant, start
        self._last = max((step[1] for step in plan.steps() if step[0] == "block"), default=0)
        self._block, self._paused = 0, False
        self._done = self._left = 0.0
        self._pressures: deque[float] = deque(maxlen=_SECOND)

    def carry_out(self, first_block: int) -> None:
        """All blocks from one on."""
        following: int | None = first_block
        while following is not None:
            following = self._blocks(following)

    def _blocks(self, first: int) -> int | None:
        """The steps of a block and of those behind it; the block to go back or on to, if any."""
        self._left = duration(self._plan, first)
        try:
            for step in self._plan.steps(first):
                left = self._left - seconds_of(step)
                self._carry_out(step)
                self._left = left
        except _BlockLeft as left:
            return left.following
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
            case ("trigger", name):
                rig.trigger(name)
            case ("note", kind, fields):
                rig.note(kind, **fields)
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
        if self._machine is not None or self._start == "at once":
            return
        rig, held = self._rig, self._held
        change = LoadChange(abs(rig.calibration.force.gain) * READINGS)
        while True:
            asked = self._look("ready", LOOK, 0, step[2])
            if not held and self._held:
                held = True
                self._attendant.tell(self._start_strokes(step))
            if self._start == "load" and change.seen(rig.force):
                return
            if asked == "go" and held:  # the first stroke itself may disturb the pressure
                return
            if asked == "go":
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
        if asked == "go" and self._paused:
            asked = "pause"
        self._obey(asked)
        return asked

    def _obey(self, asked: Request) -> None:
        match asked:
            case "pause":
                self._paused = not self._paused
                self._rig.note("paused" if self._paused else "went_on", block=self._block)
                self._attendant.tell(
                    f"block {self._block}: paused, the pressure is held; stop the strokes"
                    if self._paused
                    else f"block {self._block}: goes on"
                )
            case "skip" | "repeat":
                self._paused = False
                what = "skipped" if asked == "skip" else "repeated"
                self._rig.note(what, block=self._block)
                self._attendant.tell(f"block {self._block} is {what}: stop the strokes")
                raise _BlockLeft(self._block + (asked == "skip"))

    def _start_strokes(self, step: Step) -> str:
        """The instruction to the person at the test machine, with the measured pressure."""
        _, block, cycles, seconds, stroke, rate, _ = step
        measured, wanted = self._rig.pressure, self._rig.set_point
        held = self._held
        return (
            f"block {block}: pressure {'held' if held else 'NOT held'}, {measured / 1e3:.4g} kPa "
            f"({measured / _PSI:.4g} psi) of {wanted / 1e3:.4g} kPa ({wanted / _PSI:.4g} psi): "
            f"{'start the strokes' if held else 'do not start, or stop the run'}: {cycles} of "
            f"{stroke * 1e3:.4g} mm at {rate * 1e3:.4g} mm/s, {seconds:.0f} s"
        )
