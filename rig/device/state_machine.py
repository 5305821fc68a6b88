"""The device's control: states, guards, the control law, and the effect of each command."""

from typing import NamedTuple

from ..protocol.control_law import INTEGRAL_UNIT, ControlLaw, drive, next_integral, pressure_error
from ..protocol.messages import DRIVEN, MANUAL, RUN, SAFE, TRIP, Sample
from .plausibility import Plausibility, Tick

SILENCE, OVER_PRESSURE, JUMP, STALL, WATCHDOG, RANGE, FROZEN, NO_RESPONSE = range(1, 9)  # of FAULTS
TRIPS = (OVER_PRESSURE, JUMP, STALL, RANGE, FROZEN, NO_RESPONSE)
IN_A_ROW = 3  # conversions beyond a limit that trip
JUMP_TICKS = 5
STALL_RISE = 5  # counts that count as a rise: about 1 psi of 200
COUNTER = 0xFFFFFFFF  # records and ticks wrap here, after 99 days

OK, VERB, NUMBER, TRIPPED, NO_LIMIT, PRESSURE, RUNNING, BAUD, OUTSIDE, ABOVE_CEILING = range(10)
REASONS = (
    "OK",
    "unknown verb",
    "number missing or out of range",
    "tripped: clear first",
    "no trip limit",
    "pressure above trip",
    "running: stop first",
    "too fast for this baud",
    "reading out of range",
    "above the compiled-in ceiling",
)

LAW_FIELDS = {
    b"set": ("set_point", "feed_forward"),
    b"gain": ("proportional", "integral"),
    b"ilim": ("low", "high"),
    b"cal": ("zero", "span"),
}
"""The fields of the law that the numbers of a command set."""


LIMITS = {
    b"floor": ("floor", 1),
    b"ceiling": ("ceiling", 1),
    b"jump": ("jump", 1),
    b"stall": ("stall", 2),
    b"hbms": ("silent", 2),
}
"""The limits that act at once: attribute, and in what unit of the command's number it is kept."""


class Latch(NamedTuple):
    """What a trip leaves behind, also over a reset; `fault` is none of `TRIPS` where none is latched."""

    fault: int = 0
    output: int = 0
    reading: int = 0


class DeviceControl:
    """State machine, guards and controller: one call of `step` per tick.

    Guards compare raw counts before any arithmetic. A command's settings are staged and act from the
    first tick of the next record, so that one law governs the whole of every record; `stop` and the
    limits of the guards act at once.
    """

    def __init__(
        self, boot: int, fault: int, least_div: int, trip_ceiling: int, latch: Latch
    ) -> None:
        self._boot = boot & 15
        self._least_div = least_div  # ticks per record that the serial line can carry
        self._trip_ceiling = trip_ceiling
        self.latch = latch if latch.fault in TRIPS else Latch()
        self.tripped_at = 0
        self.state, self.fault = (TRIP, latch.fault) if self.latch.fault else (SAFE, fault)
        self.output = 0
        self.tick = 0
        self.seq = 0
        self.sync = False
        self.count = 0
        self.silence = 0
        self.law = self.next_law = ControlLaw()
        self.div = self.next_div = 5
        self.trip, self.jump, self.stall, self.silent = 0, 77, 1500, 500
        self.floor, self.ceiling = 51, 963
        self.plausibility = Plausibility()
        self.since = 0
        self.changed = False  # settings wait for the next record
        self.report_state = False
        self.report_settings = False
        self.phase = 0
        self._next_state, self._next_manual, self._next_sync = SAFE, 0, 0
        self._manual = self._sync_left = 0
        self._integral = 0
        self._sum_p = self._sum_f = 0
        self._history, self._oldest = [0] * JUMP_TICKS, 0
        self._over = self._jumped = self._outside = 0
        self._stall_ticks = self._stall_from = 0

    def step(self, pressure: int, force: int) -> Sample | None:
        """One tick: guards, output, and the record where one is complete."""
        self.tick = (self.tick + 1) & COUNTER
        if self.phase == 0:
            self._begin_record()
        oldest = self._oldest
        if self.state in DRIVEN:
            self._guard(pressure, pressure - self._history[oldest])
        else:
            self.plausibility.watch(pressure)
        self.count = self._history[oldest] = pressure
        self._oldest = oldest + 1 if oldest < JUMP_TICKS - 1 else 0
        self._sum_p += pressure
        self._sum_f += force
        self.phase += 1
        if self.state == RUN:
            self._regulate(pressure)
        elif self.state == MANUAL:
            self.output = self._manual
        return self._end_record() if self.phase == self.div else None

    def _begin_record(self) -> None:
        self._sum_p = self._sum_f = 0
        if self.changed:
            self.changed = False
            self.plausibility.change(
                self.law, self.next_law, self.trip, self._integral, self._history
            )
            self.law, self.div, self.since = self.next_law, self.next_div, self.seq
            self.report_settings = True
        if self._next_state != SAFE:
            self._enter(self._next_state)
        if self._next_sync:
            self._sync_left, self._next_sync = self._next_sync, 0
        # The pin is checked at every record only, so its edges fall between two records.
        self.sync = self._sync_left > 0
        self._sync_left -= self.sync

    def _enter(self, state: int) -> None:
        self.state, self.fault, self._next_state = state, 0, SAFE
        self._manual = self._next_manual
        self._integral = 0
        self._over = self._jumped = self._outside = self._stall_ticks = 0
        self.plausibility.enter(self.count, self._history)
        self.report_state = True

    def leave(self, state: int, fault: int, pressure: int = 0) -> None:
        """Output off, dump valve open, at once; a trip is latched with its reading and output."""
        if state == TRIP:
            self.latch, self.tripped_at = Latch(fault, self.output, pressure), self.tick
        self.plausibility.rest()
        self.state, self.fault, self._next_state = state, fault, SAFE
        self.output = self._integral = 0
        self.report_state = True

    def _out_of_range(self, pressure: int) -> bool:
        return not self.floor <= pressure <= self.ceiling

    def _guard(self, pressure: int, change: int) -> None:
        still = self.plausibility.stands_still(pressure)
        self._outside = self._outside + 1 if self._out_of_range(pressure) else 0
        self._over = self._over + 1 if pressure >= self.trip else 0
        self._jumped = 0 if -self.jump <= change <= self.jump else self._jumped + 1
        self.silence += 1
        if self._over >= IN_A_ROW:
            self.leave(TRIP, OVER_PRESSURE, pressure)
        elif self._outside >= IN_A_ROW:
            self.leave(TRIP, RANGE, pressure)
        elif self._jumped >= IN_A_ROW:
            self.leave(TRIP, JUMP, pressure)
        elif self.silence >= self.silent:
            self.leave(SAFE, SILENCE)
        elif still:
            self.leave(TRIP, FROZEN, pressure)

    def _regulate(self, pressure: int) -> None:
        law = self.law
        error = pressure_error(law, pressure)
        record = self.phase == self.div
        if record:
            self._integral = next_integral(
                law, self._integral, pressure_error(law, self._sum_p, self.div)
            )
        self.output = output = drive(law, self._integral, error)
        oldest = self._history[self._oldest]
        now = Tick(pressure, oldest, error, output, self._integral, record)
        if self._stalls(pressure, error):
            self.leave(TRIP, STALL, pressure)
        elif self.plausibility.is_frozen(now, law):
            self.leave(TRIP, FROZEN, pressure)
        elif self.plausibility.no_answer(now, law, self._history):
            self.leave(TRIP, NO_RESPONSE, pressure)

    def _stalls(self, pressure: int, error: int) -> bool:
        """Whether output or integral is at the end of its range for too long without a rise."""
        high = self.law.high
        wound = high > 0 and self._integral >= high * INTEGRAL_UNIT
        if error <= 0 or not (self.output == 255 or wound):
            self._stall_ticks = 0
            return False
        if self._stall_ticks == 0 or pressure >= self._stall_from + STALL_RISE:
            self._stall_from, self._stall_ticks = pressure, 0
        self._stall_ticks += 1
        return self._stall_ticks >= self.stall

    def _end_record(self) -> Sample:
        self.phase = 0
        seq, self.seq = self.seq, (self.seq + 1) & COUNTER
        sums = self._sum_p, self.count, self._sum_f
        flags = self.state + 4 * self.sync + 16 * self.fault
        return Sample(self._boot, seq, self.tick, *sums, self.output, self._integral, flags)

    def in_force(self) -> int:
        """The first record that a command given now governs in full."""
        return (self.seq + (self.phase > 0)) & COUNTER

    def measured(self) -> int:
        """The last pressure [1/128 psi]."""
        return self.law.set_point - pressure_error(self.law, self.count)

    def integral_counts(self) -> int:
        """The integral term [PWM counts], rounded."""
        return (self._integral + INTEGRAL_UNIT // 2) // INTEGRAL_UNIT

    def execute(self, verb: bytes, values: list[int]) -> int:
        """Carry out one command of the controller; index into `REASONS`."""
        match verb, values:
            case b"set" | b"gain" | b"ilim" | b"cal", _:
                if verb == b"cal" and self.state in DRIVEN:
                    return RUNNING
                fields = zip(LAW_FIELDS[verb], values, strict=False)  # `set` may lack the second
                self.next_law = self.next_law._replace(**dict(fields))
            case b"tele", [ticks]:
                if ticks < self._least_div:
                    return BAUD
                self.next_div = ticks
            case b"trip", [counts]:
                if counts > self._trip_ceiling:
                    return ABOVE_CEILING
                self.trip = counts
            case b"frozen", [counts, milliseconds]:
                self.plausibility.frozen = counts
                self.plausibility.frozen_ticks = milliseconds // 2
            case b"still", [milliseconds]:
                self.plausibility.still = milliseconds // 2
            case _ if verb in LIMITS:
                name, ticks = LIMITS[verb]
                setattr(self, name, values[0] // ticks)
            case _:
                return self._change_state(verb, values)
        self.changed = True
        return OK

    def _change_state(self, verb: bytes, values: list[int]) -> int:
        match verb:
            case b"run" | b"man":
                return self._start(RUN if verb == b"run" else MANUAL, *values)
            case b"stop":
                self._next_state = SAFE
                if self.state in DRIVEN:
                    self.leave(SAFE, 0)
            case b"clear":
                return self._clear()
            case b"sync":
                self._next_sync = values[0]
        return OK

    def _start(self, state: int, output: int = 0) -> int:
        if self.state == TRIP:
            return TRIPPED
        if self.trip == 0:
            return NO_LIMIT
        if self._out_of_range(self.count):
            return OUTSIDE
        self._next_state, self._next_manual = state, output
        if self.state == self._next_state == RUN:
            self._next_state = SAFE  # it runs already: nothing is staged
        return OK

    def _clear(self) -> int:
        if self.state in DRIVEN:
            return RUNNING
        if self.state == TRIP and self.trip and self.count >= self.trip:
            return PRESSURE
        if self.state == TRIP and self._out_of_range(self.count):
            return OUTSIDE
        self.latch = self.latch._replace(fault=0)
        self.leave(SAFE, 0)
        return OK
