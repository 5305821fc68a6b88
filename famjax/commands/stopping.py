"""What ends a command early: Ctrl-C, which says what is left behind, with 130; no reader, with 141.

An interrupt raised as an exception is lost in the callbacks of JAX, and aborts the process in the
import of a compiled module. A command that has nothing to undo ends without one.
"""

import os
import select
import signal
import sys
from collections.abc import Sequence
from types import FrameType

STOPPED = 130
NO_READER = 141
"""As a process that SIGPIPE ends."""

_UNDO = ("measure", "rig")
"""Commands that end by themselves: pictures under way are finished, a rig is vented."""

_NOTHING = "nothing was written"
_KEPT = "what was finished is kept in the output folder, and the same command goes on from there"
_LEFT = {
    "sweep": _KEPT,
    "compare": _KEPT,
    "characterise": _KEPT.replace("the output folder", "results"),
}
_SHOW_CURSOR = "\x1b[?25h"


def farewell(arguments: Sequence[str]) -> str:
    """What is said when the command of these arguments was stopped."""
    return f"famjax: stopped; {_LEFT.get(''.join(arguments[:1]), _NOTHING)}"


def end_at_interrupts(arguments: Sequence[str]) -> None:
    """Let an interrupt end the process of the command of these arguments, whatever it does."""
    if "".join(arguments[:1]) in _UNDO or signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        return
    text = farewell(arguments)

    def end(_number: int, frame: FrameType | None) -> None:
        while frame is not None:
            if frame.f_code.co_name == "write_all":  # files appear whole, and its draft goes
                raise KeyboardInterrupt
            frame = frame.f_back
        shown = f"\n{_SHOW_CURSOR}" if sys.stderr.isatty() else ""
        os.write(2, f"{shown}{text}\n".encode())
        os._exit(STOPPED)

    signal.signal(signal.SIGINT, end)


def reader_has_left() -> bool:
    """Whether nobody reads standard output any more, as after `| head`; it then goes nowhere."""
    out = sys.stdout.fileno()
    state = select.poll()
    state.register(out, select.POLLOUT)
    if not any(event & (select.POLLERR | select.POLLHUP) for _, event in state.poll(0)):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), out)
    return True
