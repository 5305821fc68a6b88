"""Plausibility of the readings: a live one varies at rest and follows the output, a frozen one does not."""

from collections.abc import Sequence
from typing import NamedTuple

from ..protocol.control_law import INTEGRAL_UNIT, PRESSURE_UNIT, ControlLaw, pressure_error

CLOSE_BAND = 1  # counts within which a reading that varies does not stay for 0.1 s
WIDE_BAND = 2  # the same for a second
REST_BAND = 3  # left often by a reading that is alive, at rest
WATCH_TICKS = 1000  # for which the reading is watched at rest
WATCH_DRIFT = 8  # counts: more is a pressure that falls, not noise
ALIVE_MOVES = 8  # times that it leaves its band in that time, at least
LIVELY_MOVES = 24  # so often, and `still` is enough; with fewer it takes longer
ANSWER = 5  # counts by which a pressure answers the controller, in the mean
STEP_SIZE = 3 * PRESSURE_UNIT  # a smaller one need not be answered: strokes hide it
QUICK_CHANGE = 8  # counts in four ticks: faster than strokes move a pressure
QUICK_TICKS = 500  # for which less push is allowed after that, a start or a step
OFF = 255  # of `frozen`
PUSH_LIMIT = 75  # PWM counts above the holding output that count at most
FIRST_LIMIT = 50  # the same before the circuit has answered: how slow it is is not known
MOST_PUSH = 65000  # PWM counts * ticks
HEADROOM = 20 * PRESSURE_UNIT  # with less below the limit less push is allowed
CLOSE_TICKS = 50  # for which a lively reading is never within CLOSE_BAND
LEAP = 8  # counts in one tick: no pressure stops within a tick after that
LEAP_TICKS = 20  # within CLOSE_BAND after a leap: the reading is not the pressure's
SETTLED_SHIFT = 7  # the settled one, which knows nothing of a wound integral, of 128
HELD_SHIFT = 9  # the holding output follows with a time constant of 512 records

NOT_KNOWN, QUIET, ALIVE = range(3)
"""Whether the reading was seen to vary at rest, as that of a transducer with noise does."""


NOTHING, STEP, START = range(3)
"""What the pressure has to answer."""


class Band:
    """Readings from which the present one has not moved away."""

    __slots__ = ("high", "low")

    def __init__(self) -> None:
        self.low = self.high = 0

    def left(self, reading: int, width: int) -> bool:
        """Whether the reading has left the band, which then begins anew with it."""
        if reading < self.low:
            self.low = reading
        elif reading > self.high:
            self.high = reading
        if self.high - self.low <= width:
            return False
        self.low = self.high = reading
        return True


class Tick(NamedTuple):
    """One tick of the controller.

    Attributes:
        reading: counts.
        oldest: the reading four ticks before.
        error: [1/128 psi].
        output: PWM counts.
        integral: [1/32768 PWM count].
        record: whether a record ends with it.
    """

    reading: int
    oldest: int
    error: int
    output: int
    integral: int
    record: bool


class Plausibility:
    """Watches the readings at rest, and in RUN whether they follow the output.

    Attributes:
        still: ticks within `WIDE_BAND` that trip, of a reading that is alive; a less lively one has longer.
        frozen: PWM counts by which the output may exceed the one that held the pressure.
        frozen_ticks: ticks at twice that output that trip; fewer at a higher one.
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
        """The output comes on; `recent` are the last five readings, `reading` the last."""
        self._close.low = self._close.high = reading
        self._held = self._settled = self._still_ticks = self._close_ticks = 0
        self._push = self._wound_push = 0
        self._leapt = False
        self._expect_answer(START, 0, recent)

    def rest(self) -> None:
        """The output goes off: what was watched before does not count."""
        self._watch_ticks = 0

    def change(
        self,
        before: ControlLaw,
        law: ControlLaw,
        trip: int,
        integral: int,
        recent: Sequence[int],
    ) -> None:
        """Another law governs, or another limit; an answer is due to a higher set point."""
        if law.set_point >= before.set_point + STEP_SIZE and self._asked == NOTHING:
            self._expect_answer(STEP, integral, recent)
        self._headroom = -pressure_error(law, trip)

    def watch(self, reading: int) -> None:
        """One reading at rest: does noise move it? Only one that is alive can be seen to freeze."""
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
        """Whether a reading that is alive has not varied for too long."""
        self._still_ticks = 0 if self._wide.left(reading, WIDE_BAND) else self._still_ticks + 1
        enough = self._still_ticks * self._liveliness >= self.still * LIVELY_MOVES
        return enough and self.alive != QUIET

    def is_frozen(self, now: Tick, law: ControlLaw) -> bool:
        """Whether the output has pushed more than a reading that has not moved can bear."""
        self._close_ticks += 1
        before = self._close.low
        if self._close.left(now.reading, CLOSE_BAND):
            self._held = now.integral
            self._leapt = abs(now.reading - before) > LEAP
            self._close_ticks = self._push = self._wound_push = 0
        if abs(now.reading - now.oldest) >= QUICK_CHANGE:
            self._quick_ticks = QUICK_TICKS
        elif self._quick_ticks:
            self._quick_ticks -= 1
        least = min(self._settled, self._held)
        self._push = self._pushed(self._push, now.output, self._held, law, self.frozen)
        slack = OFF if self.frozen == OFF else 0
        self._wound_push = self._pushed(self._wound_push, now.output, least, law, slack)
        if now.record:
            self._held += (now.integral - self._held) >> HELD_SHIFT
            self._settled += (now.integral - self._settled) >> SETTLED_SHIFT
        enough = LEAP_TICKS if self._leapt else CLOSE_TICKS
        rests = self._close_ticks * self._liveliness >= enough * LIVELY_MOVES
        wound = self.alive != QUIET and rests
        push = max(self._push, self._wound_push) if wound else self._push
        half = now.error // 2 if now.error >= 0 else -(-now.error // 2)  # as C divides
        known = 0 if self._leapt else self._headroom + half  # it may have been at the limit
        headroom = max(min(known, HEADROOM), HEADROOM // 4)
        quiet = self.alive == QUIET and self._asked != START
        share = (1 if self._quick_ticks else 2) << quiet
        return push * HEADROOM >= self.frozen * self.frozen_ticks * share * headroom

    def no_answer(self, now: Tick, law: ControlLaw, recent: Sequence[int]) -> bool:
        """Whether the mean pressure does not follow a start or a higher set point."""
        if self._asked == NOTHING:
            return False
        quiet = self.alive == QUIET
        slack = self.frozen // 4 if quiet and self.frozen != OFF else self.frozen
        self._answer_push = self._pushed(
            self._answer_push, now.output, self._answer_held, law, slack
        )
        if self._answer_push >= self.frozen * self.frozen_ticks << (self._asked == STEP):
            return True
        answered = abs(sum(recent) - self._answer_sum) >= ANSWER * len(recent)
        reached = now.record and now.error <= (law.span * (1 if quiet else ANSWER)) >> 9
        if answered or reached:
            self._asked = NOTHING
        return False

    def _expect_answer(self, to: int, integral: int, recent: Sequence[int]) -> None:
        self._asked, self._answer_push, self._quick_ticks = to, 0, QUICK_TICKS
        self._answer_held, self._answer_sum = integral, sum(recent)

    def _pushed(self, push: int, output: int, held: int, law: ControlLaw, slack: int) -> int:
        """What the output has pushed so far [counts * ticks], from what exceeds the one that held."""
        holding = (law.feed_forward * PRESSURE_UNIT + held + INTEGRAL_UNIT // 2) // INTEGRAL_UNIT
        limit = FIRST_LIMIT if self._asked == START else PUSH_LIMIT
        excess = min(output - slack - holding, limit)
        return push if excess >= 0 and push >= MOST_PUSH else max(push + excess, 0)
