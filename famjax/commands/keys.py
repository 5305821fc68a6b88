"""Single key presses on a terminal, without waiting for them."""

import contextlib
import os
import sys
from collections.abc import Callable, Iterator

Keys = Callable[[], str]
"""The next key, "" where none was pressed; Enter is a line feed."""


def has_keys() -> bool:
    """Whether a person can press keys here and see what they do."""
    return sys.stdin.isatty() and sys.stdout.isatty()


@contextlib.contextmanager
def single_keys() -> Iterator[Keys]:
    """Takes key presses one by one until it ends; no terminal gives none. Ctrl-C stays Ctrl-C."""
    if not has_keys():
        yield lambda: ""
    elif sys.platform == "win32":
        import msvcrt

        def typed() -> str:
            return msvcrt.getwch().replace("\r", "\n") if msvcrt.kbhit() else ""

        yield typed
    else:
        import select
        import termios
        import tty

        terminal = sys.stdin.fileno()
        before = termios.tcgetattr(terminal)

        def pressed() -> str:
            ready, _, _ = select.select([terminal], [], [], 0)
            return os.read(terminal, 1).decode("ascii", "ignore") if ready else ""

        tty.setcbreak(terminal)
        try:
            yield pressed
        finally:
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)
