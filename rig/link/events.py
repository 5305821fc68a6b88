"""The events of a session besides the device's own messages."""

from typing import NamedTuple

from ..protocol.messages import Message


class Lost(NamedTuple):
    """Records that will never come: first <= seq < first + records of that boot."""

    boot: int
    first: int
    records: int


class Reset(NamedTuple):
    """The device restarted; boots modulo 16, `cause` as in `Hello`, None where no hello came."""

    old: int
    new: int
    cause: int | None


class Silent(NamedTuple):
    """No verified line for that many seconds; one such event for each silence."""

    seconds: float


class Timing(NamedTuple):
    """The record of its quarter second with the shortest latency: its tick and time of arrival [s]."""

    boot: int
    tick: int
    arrival_s: float


NOTES = {Lost: "lost", Reset: "reset", Silent: "silent", Timing: "clock"}
"""Events that a journal notes, and the kind of note; its fields are those of the event."""

Event = Message | Lost | Reset | Silent | Timing
