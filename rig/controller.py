"""Device controller in the firmware's integer arithmetic: states, guards, control law, plausibility."""

from collections.abc import Sequence
from typing import NamedTuple

from .protocol import (
    DRIVEN,
    INTEGRAL_UNIT,
    MANUAL,
    PRESSURE_UNIT,
    RUN,
    SAFE,
    TRIP,
    ControlLaw,
    DeviceSettings,
    Sample,
    drive,
    next_integral,
    pressure_error,
)

SILENCE, OVER_PRESSURE, JUMP, STALL, WATCHDOG, RANGE, FROZEN, NO_RESPONSE = range(1, 9)  # FAULTS
TRIPS = (OVER_PRESSURE, JUMP, STALL, RANGE, FROZEN, NO_RESPONSE)
IN_A_ROW = 3  # consecutive conversions beyond a limit that cause a trip
JUMP_TICKS = 5
STALL_RISE = 5  # smallest rise in counts, about 1 psi of 200
NO_BOARD = 0xFFFF  # in a blank memory
COUNTER = 0xFFFFFFFF  # records and ticks wrap here, after 99 days

OK, VERB, NUMBER, TRIPPED, NO_LIMIT, PRESSURE, RUNNING, BAUD, OUTSIDE, ABOVE_CEILING = range(10)
REASONS = ("OK", "unknown verb", "number missing or out of range", "tripped: clear first",
           "no trip limit", "pressure above trip", "running: stop first", "too fast for this baud",
           "reading out of range", "above the compiled-in ceiling")  # fmt: skip

# Fields of the law set by the numbers of a command.
LAW_FIELDS = {
    b"set": ("set_point", "feed_forward"),
    b"gain": ("proportional", "integral"),
    b"ilim": ("low", "high"),
    b"cal": ("zero", "span"),
}

# Limits that act immediately: attribute, and the factor by which the command's number is divided.
LIMITS = {
    b"floor": ("floor", 1),
    b"ceiling": ("ceiling", 1),
    b"jump": ("jump", 1),
    b"stall": ("stall", 2),
    b"hbms": ("silent", 2),
}

CLOSE_BAND = 1  # counts; a varying reading leaves this band within 0.1 s
WIDE_BAND = 2  # counts; a varying reading leaves this band within a second
REST_BAND = 3  # counts; a varying reading often leaves this band at rest
WATCH_TICKS = 1000  # ticks for which the reading is observed at rest
WATCH_DRIFT = 8  # counts; a larger change is a falling pressure, not noise
ALIVE_MOVES = 8  # smallest number of times that a varying reading leaves its band in that time
LIVELY_MOVES = 24  # number from which `still` applies unchanged; with fewer, the time is longer
ANSWER = 5  # mean counts by which a pressure must respond to the controller
STEP_SIZE = 3 * PRESSURE_UNIT  # smaller steps need no response, because strokes hide it
QUICK_CHANGE = 8  # counts in four ticks, faster than strokes change a pressure
QUICK_TICKS = 500  # ticks of a reduced push limit after such a change, a start or a step
OFF = 255  # value of `frozen` that disables the guard
PUSH_LIMIT = 75  # largest excess over the holding output that counts [PWM counts]
FIRST_LIMIT = 50  # the same before the circuit has responded, while its speed is unknown
MOST_PUSH = 65000  # PWM counts * ticks
HEADROOM = 20 * PRESSURE_UNIT  # distance from the limit below which less push is allowed
CLOSE_TICKS = 50  # ticks for which a lively reading never stays in CLOSE_BAND
LEAP = 8  # counts in one tick, after which no pressure stops within a tick
LEAP_TICKS = 20  # ticks in CLOSE_BAND after a leap, after which the reading is not believed
SETTLED_SHIFT = 7  # the settled output follows with a time constant of 128 records
HELD_SHIFT = 9  # the holding output follows with a time constant of 512 records

# Whether the reading has varied at rest, as the reading of a noisy transducer does.
NOT_KNOWN, QUIET, ALIVE = range(3)

NOTHING, STEP, START = range(3)  # events to which the pressure must respond


class Latch(NamedTuple):
    """State that survives a reset: a trip if `fault` is one of `TRIPS`, and the board number or 0."""

    fault: int = 0
    output: int = 0
    reading: int = 0
    board: int = 0


class DeviceControl:
    """State machine, guards and controller; `step` is called once per tick.

    The guards compare raw counts before any arithmetic. Settings take effect at the first tick of the next
    record, so that each record is governed by a single law. `stop` and the guards' limits take effect at
    once.
    """

    def __init__(
        self, boot: int, fault: int, least_div: int, trip_ceiling: int, latch: Latch
    ) -> None:
        self.boot = boot
        self._least_div = least_div  # fewest ticks per record that the line allows
        self._trip_ceiling = trip_ceiling
        board = 0 if latch.board == NO_BOARD else latch.board
        self.latch = latch._replace(board=board) if latch.fault in TRIPS else Latch(board=board)
        self.state, self.fault = (TRIP, latch.fault) if self.latch.fault else (SAFE, fault)
        self.output = self.tick = self.seq = self.count = self.silence = 0
        self.phase = self.since = self.tripped_at = 0
        self.sync = self.report_state = self.report_settings = False
        self.changed = False  # True if settings wait for the next record
        self.law = self.next_law = ControlLaw()
        self.div = self.next_div = 5
        self.trip, self.jump, self.stall, self.silent = 0, 77, 1500, 500
        self.floor, self.ceiling = 51, 963
        self.plausibility = Plausibility()
        self._next_state, self._next_manual, self._next_sync = SAFE, 0, 0
        self._manual = self._sync_left = self._integral = self._sum_p = self._sum_f = 0
        self._history, self._oldest = [0] * JUMP_TICKS, 0
        self._over = self._jumped = self._outside = self._stall_ticks = self._stall_from = 0

    def step(self, pressure: int, force: int) -> Sample | None:
        """Run one tick; return the record if one is complete."""
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
        # The pin changes only between two records.
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
        """Switch off the output and open the dump valve; latch a trip, its reading and its output."""
        if state == TRIP:
            self.latch = Latch(fault, self.output, pressure, self.latch.board)
            self.tripped_at = self.tick
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
        if self._stalls(pressure, error):
            self.leave(TRIP, STALL, pressure)
        elif self.plausibility.is_frozen(
            law, output, self._integral, error, record, pressure, oldest
        ):
            self.leave(TRIP, FROZEN, pressure)
        elif self.plausibility.no_answer(law, output, error, record, self._history):
            self.leave(TRIP, NO_RESPONSE, pressure)

    def _stalls(self, pressure: int, error: int) -> bool:
        """Return True if output or integral is at its limit for too long without a pressure rise."""
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
        return Sample(self.boot & 15, seq, self.tick, *sums, self.output, self._integral, flags)

    def in_force(self) -> int:
        """Return the number of the first record fully governed by a command that arrives now."""
        return (self.seq + (self.phase > 0)) & COUNTER

    @property
    def settings(self) -> DeviceSettings:
        """Settings that govern the records from `since` onwards."""
        guards = self.div, self.trip, self.jump, self.stall, self.silent, self.floor, self.ceiling
        watch = self.plausibility
        frozen = watch.still, watch.frozen, watch.frozen_ticks
        return DeviceSettings(self.boot, self.since, self.law, *guards, *frozen)

    def execute(self, verb: bytes, values: list[int]) -> int:
        """Execute a controller command; return an index into `REASONS`."""
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
            self._next_state = SAFE  # already running
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


class Band:
    """The band that contains the latest readings."""

    __slots__ = ("high", "low")

    def __init__(self) -> None:
        self.low = self.high = 0

    def left(self, reading: int, width: int) -> bool:
        """Return True if the reading has left the band, which then restarts at this reading."""
        if reading < self.low:
            self.low = reading
        elif reading > self.high:
            self.high = reading
        if self.high - self.low <= width:
            return False
        self.low = self.high = reading
        return True


class Plausibility:
    """Observe the readings at rest, and check in RUN whether they follow the output.

    Attributes:
        still: ticks after which the device trips if a reading that varied at rest stays within
            `WIDE_BAND`; more ticks are needed if it varied less.
        frozen: PWM counts by which the output may exceed the holding output.
        frozen_ticks: ticks after which the device trips if the output is at twice that excess; fewer ticks
            are needed at a larger excess.
        alive: `NOT_KNOWN`, `QUIET` or `ALIVE`.
    """

    def __init__(self) -> None:
        self.still, self.frozen, self.frozen_ticks = 350, 4, 375
        self.alive, self._liveliness = NOT_KNOWN, LIVELY_MOVES
        self._close, self._wide = Band(), Band()
        self._held = self._settled = self._answer_held = 0
        self._headroom = self._still_ticks = self._close_ticks = 0
        self._push = self._wound_push = self._answer_push = self._answer_sum = 0
        self._watch_ticks = self._watch_from = self._moves = 0
        self._asked, self._quick_ticks = NOTHING, 0
        self._leapt = False

    def enter(self, reading: int, recent: Sequence[int]) -> None:
        """Start checking with the output on; `recent` is the last five readings, `reading` the latest."""
        self._close.low = self._close.high = reading
        self._held = self._settled = self._still_ticks = self._close_ticks = 0
        self._push = self._wound_push = 0
        self._leapt = False
        self._expect_answer(START, 0, recent)

    def rest(self) -> None:
        """Discard earlier observations, because the output is being switched off."""
        self._watch_ticks = 0

    def change(
        self, before: ControlLaw, law: ControlLaw, trip: int, integral: int, recent: Sequence[int]
    ) -> None:
        """Process a new law or limit; the pressure must respond to a higher set point."""
        if law.set_point >= before.set_point + STEP_SIZE and self._asked == NOTHING:
            self._expect_answer(STEP, integral, recent)
        self._headroom = -pressure_error(law, trip)

    def watch(self, reading: int) -> None:
        """Observe a reading at rest; freezing can be detected only if the reading normally varies."""
        if self._watch_ticks == 0:
            self._watch_from, self._moves = reading, 0
        self._moves += self._wide.left(reading, REST_BAND)
        self._watch_ticks += 1
        if self._watch_ticks == WATCH_TICKS:
            self._watch_ticks = 0
            if abs(reading - self._watch_from) <= WATCH_DRIFT:
                self.alive = ALIVE if self._moves >= ALIVE_MOVES else QUIET
                self._liveliness = min(self._moves, LIVELY_MOVES)

    def stands_still(self, reading: int) -> bool:
        """Return True if a reading that varied at rest has been constant for too long."""
        self._still_ticks = 0 if self._wide.left(reading, WIDE_BAND) else self._still_ticks + 1
        enough = self._still_ticks * self._liveliness >= self.still * LIVELY_MOVES
        return enough and self.alive != QUIET

    def is_frozen(
        self, law: ControlLaw, output: int, integral: int, error: int, record: bool, reading: int,
        oldest: int,
    ) -> bool:  # fmt: skip
        """Return True if the output has changed too much although the reading has not changed."""
        self._close_ticks += 1
        before = self._close.low
        if self._close.left(reading, CLOSE_BAND):
            self._held = integral
            self._leapt = abs(reading - before) > LEAP
            self._close_ticks = self._push = self._wound_push = 0
        if abs(reading - oldest) >= QUICK_CHANGE:
            self._quick_ticks = QUICK_TICKS
        elif self._quick_ticks:
            self._quick_ticks -= 1
        least = min(self._settled, self._held)
        self._push = self._pushed(self._push, output, self._held, law, self.frozen)
        slack = OFF if self.frozen == OFF else 0
        self._wound_push = self._pushed(self._wound_push, output, least, law, slack)
        if record:
            self._held += (integral - self._held) >> HELD_SHIFT
            self._settled += (integral - self._settled) >> SETTLED_SHIFT
        enough = LEAP_TICKS if self._leapt else CLOSE_TICKS
        rests = self._close_ticks * self._liveliness >= enough * LIVELY_MOVES
        wound = self.alive != QUIET and rests
        push = max(self._push, self._wound_push) if wound else self._push
        half = error // 2 if error >= 0 else -(-error // 2)  # division as in C
        known = 0 if self._leapt else self._headroom + half  # after a leap it may be at the limit
        headroom = max(min(known, HEADROOM), HEADROOM // 4)
        quiet = self.alive == QUIET and self._asked != START
        share = (1 if self._quick_ticks else 2) << quiet
        return push * HEADROOM >= self.frozen * self.frozen_ticks * share * headroom

    def no_answer(
        self, law: ControlLaw, output: int, error: int, record: bool, recent: Sequence[int]
    ) -> bool:
        """Return True if the mean pressure does not respond to a start or a higher set point."""
        if self._asked == NOTHING:
            return False
        quiet = self.alive == QUIET
        slack = self.frozen // 4 if quiet and self.frozen != OFF else self.frozen
        self._answer_push = self._pushed(self._answer_push, output, self._answer_held, law, slack)
        if self._answer_push >= self.frozen * self.frozen_ticks << (self._asked == STEP):
            return True
        answered = abs(sum(recent) - self._answer_sum) >= ANSWER * len(recent)
        reached = record and error <= (law.span * (1 if quiet else ANSWER)) >> 9
        if answered or reached:
            self._asked = NOTHING
        return False

    def _expect_answer(self, to: int, integral: int, recent: Sequence[int]) -> None:
        self._asked, self._answer_push, self._quick_ticks = to, 0, QUICK_TICKS
        self._answer_held, self._answer_sum = integral, sum(recent)

    def _pushed(self, push: int, output: int, held: int, law: ControlLaw, slack: int) -> int:
        """Return the sum over time of the output's excess over the holding output [counts * ticks]."""
        holding = (law.feed_forward * PRESSURE_UNIT + held + INTEGRAL_UNIT // 2) // INTEGRAL_UNIT
        limit = FIRST_LIMIT if self._asked == START else PUSH_LIMIT
        excess = min(output - slack - holding, limit)
        return push if excess >= 0 and push >= MOST_PUSH else max(push + excess, 0)
