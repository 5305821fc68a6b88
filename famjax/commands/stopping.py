"""What Ctrl-C does to a command: it says what is left behind, and ends with 130.

An interrupt raised as an exception is lost in the callbacks of JAX, and aborts the process in the
import of a compiled module. A command that has nothing to undo ends without one.
"""

import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType

STOPPED = 130
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
