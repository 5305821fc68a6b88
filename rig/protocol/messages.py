"""The device's messages: samples, status, settings, answers; plain tuples of integers."""

from typing import NamedTuple

from .control_law import ControlLaw

PROTOCOL = 2
"""Version of the protocol, field `proto` of the hello line."""

SAFE, RUN, MANUAL, TRIP = range(4)
"""States of the device."""

DRIVEN = (RUN, MANUAL)
"""States in which the output is not off and the dump valve is shut."""

STATES = ("SAFE", "RUN", "MAN", "TRIP")

FAULTS = (
    "none",
    "silence",
    "over-pressure",
    "jump",
    "stall",
    "watchdog",
    "range",
    "frozen",
    "no response",
)
"""Why the device left RUN or MAN on its own, or started with the output off."""


class Sample(NamedTuple):
    """One record: `T,boot,seq,tick,p,q,f,u,i,st`.

    Attributes:
        boot: the boot counter modulo 16.
        seq: number of the record since boot.
        tick: the 2 ms tick it ended with, counted since boot.
        pressure_sum: sum of the pressure counts over the ticks of the record.
        pressure_count: the pressure count of the last tick.
        force_sum: sum of the force counts over the ticks of the record.
        output: u [PWM counts], set from `pressure_count` and `integral`.
        integral: I [1/32768 PWM count].
        flags: state + 4 * sync + 16 * fault.
    """

    boot: int
    seq: int
    tick: int
    pressure_sum: int
    pressure_count: int
    force_sum: int
    output: int
    integral: int
    flags: int

    @property
    def state(self) -> int:
        """`SAFE`, `RUN`, `MANUAL` or `TRIP`, at the last tick."""
        return self.flags & 3

    @property
    def sync(self) -> bool:
        """Whether the sync pin is high."""
        return bool(self.flags & 4)

    @property
    def fault(self) -> int:
        """Index into `FAULTS`."""
        return self.flags >> 4


class DeviceStatus(NamedTuple):
    """`S,boot,seq,tick,state,fault,p,bad,good,overrun,dropped,late,at,counts,u,alive`.

    Counters wrap at 65536. Lines of protocol 1 end with `late`.

    Attributes:
        boot: the boot counter.
        seq: number of the next record.
        tick: the tick of this line.
        state: as in `Sample`.
        fault: as in `Sample`.
        pressure_count: the last pressure count.
        bad: lines of the host that were refused: CRC, length, no CRC under `strict 1`.
        good: lines of the host that were accepted.
        overrun: bytes of the host for which there was no room.
        dropped: lines of the device for which there was no room.
        late: ticks that came late.
        tripped_at: tick of the last trip since the boot, 0 where there was none or it is older.
        tripped_count: the pressure count that tripped.
        tripped_output: the output [PWM counts] before it was taken off.
        alive: whether the reading varied at rest: 0 not known yet, 1 quiet, 2 alive.
    """

    boot: int
    seq: int
    tick: int
    state: int
    fault: int
    pressure_count: int
    bad: int
    good: int
    overrun: int
    dropped: int
    late: int
    tripped_at: int = 0
    tripped_count: int = 0
    tripped_output: int = 0
    alive: int = 0


class DeviceSettings(NamedTuple):
    """What governs the records from `since` on.

    `P,boot,since,<law>,div,trip,jump,stall,silence,floor,ceiling,still,frozen,frozen_ticks`; lines of
    protocol 1 end with `silence`.

    Attributes:
        boot: the boot counter.
        since: the first record that all of this governs.
        law: the control law.
        ticks_per_record: as set by `tele`.
        trip: over-pressure limit [counts]; 0 where none has been set.
        jump: limit of the change over 5 ticks [counts].
        stall: ticks with output or integral at its upper limit without a rise.
        silence: ticks without an accepted line.
        floor: least reading that is plausible [counts].
        ceiling: greatest one.
        still: ticks within two counts of a reading that varied at rest.
        frozen: PWM counts by which the output may exceed the one that held the pressure.
        frozen_ticks: ticks at twice that output without a move of the reading.
    """

    boot: int
    since: int
    law: ControlLaw
    ticks_per_record: int
    trip: int
    jump: int
    stall: int
    silence: int
    floor: int = 0
    ceiling: int = 1023
    still: int = 0
    frozen: int = 0
    frozen_ticks: int = 0


class Hello(NamedTuple):
    """`H,famrig,proto,fw,boot,cause,tick_hz,div,ring,budget,limit`; protocol 1 ends with `budget`.

    Attributes:
        protocol: `PROTOCOL`.
        firmware: version of the firmware.
        boot: the boot counter.
        cause: of the reset: 1 power, 2 reset pin, 4 brown-out, 8 watchdog, 0 unknown.
        tick_hz: ticks per second.
        ticks_per_record: as set by `tele`.
        ring: records that the device can still repeat.
        bytes_per_tick: bytes that it can send in a tick.
        trip_ceiling: highest pressure limit that it takes [counts].
    """

    protocol: int
    firmware: int
    boot: int
    cause: int
    tick_hz: int
    ticks_per_record: int
    ring: int
    bytes_per_tick: int
    trip_ceiling: int = 1023


class Ack(NamedTuple):
    """`A,id,OK,seq` or `A,id,ERR,why`.

    Attributes:
        id: of the command.
        seq: the first record that the command governs in full; None where it was refused.
        reason: why it was refused; empty where it was not.
    """

    id: int
    seq: int | None
    reason: str


class StoredRange(NamedTuple):
    """`L,oldest,next`: the records that can still be repeated, oldest <= seq < next."""

    oldest: int
    next: int


class Comment(NamedTuple):
    """`# text`, to be read in a terminal."""

    text: str


Message = Sample | DeviceStatus | DeviceSettings | Hello | Ack | StoredRange | Comment
