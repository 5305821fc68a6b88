"""A plan carried out on a rig, and the pump stepped for its feed-forward."""

from collections.abc import Callable, Sequence
from typing import Protocol

from famjax.boundary.units import UNITS

from ..calibration.feed_forward import FeedForward, fit_feed_forward
from ..calibration.whole_rig import Calibration
from ..errors import RigError
from .plan import Plan, Step, duration, highest_pressure
from .rig import LOOK, Rig

HELD = 1 * UNITS["pressure"]["psi"]
"""How far from the set pressure [Pa] one still counts as held: three times what is measured of it."""
_PSI = UNITS["pressure"]["psi"]

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
    progress: Callable[[float, float], None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> None:
    """Carry out a plan from a block on and stop the rig.

    Args:
        rig: entered, so that it vents whatever happens.
        plan: what to do.
        machine: makes the strokes; without one the plan waits for as long as they last.
        first_block: where to begin; `next_block` of a journal's notes resumes it.
        progress: called about every second of the rig's time with the seconds done and planned.
        tell: called with what a person at the machine has to do: start the strokes.

    Raises:
        RigError: as `check_plan`; nothing has been started then.
        RigFault: the test had to stop.
    """
    check_plan(plan, rig.calibration, rig.pressure_limit, first_block)
    planned = duration(plan, first_block)
    rig.note("plan", plan=repr(plan), first_block=first_block, seconds=planned)
    if progress is not None:
        rig.on_look = _every_second(progress, rig.link.now, planned)
    for step in plan.steps(first_block):
        if tell is not None and step[0] == "strokes":
            tell(_start_strokes(rig, step))
        _carry_out(rig, step, machine)
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


def _start_strokes(rig: Rig, step: Step) -> str:
    """What a person at the test machine is told, with the pressure that is measured."""
    _, block, cycles, seconds, stroke, rate, _ = step
    measured, wanted = rig.pressure, rig.set_point
    held = abs(measured - wanted) <= HELD
    return (
        f"block {block}: pressure {'held' if held else 'NOT held'}, {measured / 1e3:.4g} kPa "
        f"({measured / _PSI:.4g} psi) of {wanted / 1e3:.4g} kPa ({wanted / _PSI:.4g} psi): "
        f"{'start the strokes' if held else 'do not start, or stop the run'}: {cycles} of "
        f"{stroke * 1e3:.4g} mm at {rate * 1e3:.4g} mm/s, {seconds:.0f} s"
    )


def _every_second(
    progress: Callable[[float, float], None], begin: float, planned: float
) -> Callable[[float], None]:
    """Reports progress at times that are a second apart at least."""
    due = begin

    def report(now: float) -> None:
        nonlocal due
        if now >= due:
            due = now + 1.0
            progress(min(now - begin, planned), planned)

    return report


def _carry_out(rig: Rig, step: Step, machine: Machine | None) -> None:
    match step:
        case ("block", block, pressure):
            rig.note("block", block=block, pressure_Pa=pressure)
        case ("set", pressure):
            rig.set_pressure(pressure)
        case ("wait", seconds):
            rig.wait(seconds)
        case ("strokes", block, cycles, seconds, stroke, rate, every):
            rig.note(
                "strokes",
                block=block,
                cycles=cycles,
                seconds=seconds,
                stroke_m=stroke,
                rate_m_per_s=rate,
            )
            rig.sync(sync_seconds(block))
            if machine is not None:
                machine.start(cycles, rate, stroke=stroke)
            _wait_for_strokes(rig, block, seconds, every, machine)
            rig.note("strokes_end", block=block)
        case ("trigger", name):
            rig.trigger(name)
        case ("note", kind, fields):
            rig.note(kind, **fields)
        case ("done", block):
            rig.note("done", block=block)
        case _:
            raise RigError(f"unknown step {step!r} of a plan")


def sync_seconds(block: int) -> float:
    """How long the sync pin is high at the first stroke of a block [s].

    Each of sixteen blocks has its own length, so that a log that lacks some pulses still matches
    in one way only; each is an odd number of records of 10 ms, so that in a log of 50 rows a second
    both edges do not fall alike between two rows.

    >>> sync_seconds(0), sync_seconds(3)
    (0.51, 1.29)
    """
    return 0.51 + 0.26 * (block % PULSES)


def _wait_for_strokes(
    rig: Rig, block: int, seconds: float, every: float, machine: Machine | None
) -> None:
    """Until the machine is done, or for as long as its strokes last; triggers at equal distances."""
    start, photographs = rig.link.now, 0
    while True:
        passed = rig.link.now - start
        if every and passed >= photographs * every - 1e-9:
            rig.trigger(f"block{block:02d}-{photographs:05d}")
            photographs += 1
        if (not machine.busy) if machine is not None else passed >= seconds - 1e-9:
            return
        ends = [LOOK if machine is not None else seconds - passed]
        if every:
            ends.append(photographs * every - passed)
        rig.wait(max(min(ends), 1e-3))


def calibrate_feed_forward(
    rig: Rig, outputs: Sequence[int], *, settle: float = 3.0, average: float = 1.0
) -> FeedForward:
    """The feed-forward from steps of the pump or valve, the controller off.

    Args:
        rig: entered.
        outputs: steps [counts, 0..255]; going up and down again shows hysteresis as scatter.
        settle: time after each step [s].
        average: time of each mean [s].

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
        counts, _ = rig.average(average)
        pressures.append(float(rig.calibration.pressure.value(counts)))
        rig.note("step", output=int(output), pressure_Pa=pressures[-1])
    rig.stop()
    return fit_feed_forward(pressures, outputs)
