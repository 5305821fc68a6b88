"""A run on a terminal: live values, what to do, and keys that steer it; lines elsewhere."""

import contextlib
from collections.abc import Iterator
from time import monotonic

from rich.console import Console
from rich.live import Live
from rich.text import Text

from rig.calibration import Calibration
from rig.control import Attendant, Request, Situation

from ..keys import Keys, has_keys, single_keys
from .monitor import Monitor

KEYS: dict[str, Request] = {"\n": "go", " ": "go", "p": "pause", "s": "skip", "r": "repeat"}
TWICE: dict[Request, str] = {
    "skip": "s once more leaves this block for good",
    "repeat": "r once more begins this block anew, what was recorded of it does not count",
}
"""Requests that cost a block, and what is said before they are obeyed."""
HELP = "Enter: strokes have begun, or go on  p: pause  s: skip the block  r: repeat it  Ctrl-C: end"

_REDRAW = 0.2  # s between two pictures
_LINE = 15.0  # s between two lines where there is no terminal
_AGAIN = 5.0  # s within which a key has to be pressed once more
_COLUMN = 4  # looks that one column of the plot stands for


def clock(seconds: float) -> str:
    """A duration as a person says it.

    >>> clock(70.0), clock(9.4)
    ('70 s (1 min 10 s)', '9 s')
    """
    minutes, left = divmod(round(seconds), 60)
    return f"{seconds:.0f} s ({minutes} min {left} s)" if minutes else f"{seconds:.0f} s"


@contextlib.contextmanager
def attended(calibration: Calibration, units: str) -> Iterator[Attendant]:
    """Who attends a run here: a person at a terminal, or a script's log."""
    monitor = Monitor(calibration, units, every=_COLUMN)
    if not has_keys():
        yield _Log(monitor)
        return
    with (
        single_keys() as keys,
        Live(console=Console(highlight=False), auto_refresh=False, transient=True) as live,
    ):
        yield _Person(monitor, keys, live)


class _Log(Attendant):
    """Prints what a person has to do, and a line for every quarter of a minute."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._due = monotonic() + _LINE

    def tell(self, text: str) -> None:
        print(text, flush=True)

    def look(self, situation: Situation) -> Request:
        if monotonic() >= self._due:
            self._due = monotonic() + _LINE
            if situation.newest is not None:
                self._monitor.add(situation.newest)
            self.tell(f"{_where(situation)}  {self._monitor.line(situation.set_point)}")
        return ""


class _Person(Attendant):
    """Shows a picture that is drawn anew, and asks for what a key stands for."""

    def __init__(self, monitor: Monitor, keys: Keys, live: Live) -> None:
        self._monitor, self._keys, self._live = monitor, keys, live
        self._due = 0.0
        self._asked: tuple[Request, float] = ("", 0.0)

    def tell(self, text: str) -> None:
        self._live.console.print(Text(text))

    def look(self, situation: Situation) -> Request:
        if situation.newest is not None:
            self._monitor.add(situation.newest)
        if monotonic() >= self._due:
            self._due = monotonic() + _REDRAW
            lines = (
                _where(situation), self._monitor.line(situation.set_point), self._monitor.plot(),
                HELP,
            )  # fmt: skip
            self._live.update(Text("\n".join(lines)), refresh=True)
        return self._meant(KEYS.get(self._keys().lower(), ""))

    def _meant(self, request: Request) -> Request:
        """The request; one that costs a block only when it comes twice."""
        if request not in TWICE:
            return request
        before, at = self._asked
        if request == before and monotonic() - at <= _AGAIN:
            self._asked = ("", 0.0)
            return request
        self._asked = (request, monotonic())
        self.tell(TWICE[request])
        return ""


def _where(situation: Situation) -> str:
    """Where in its plan a run is."""
    cycle = f" {situation.cycle} of {situation.cycles}" if situation.cycle else ""
    phase = {"ready": "waits for the first stroke"}.get(situation.phase, situation.phase)
    return (
        f"block {situation.block} (the last is {situation.last_block}): {phase}{cycle}, "
        f"{clock(situation.left)} left"
    )
