"""Exit codes of a rig's faults and of signals."""

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def rig_problems() -> Iterator[None]:
    """Ends the command with exit code 1 where the rig had to stop, and with 130 on a signal."""
    from rig import RigFault

    try:
        with _signals_as_ctrl_c():
            yield
    except RigFault as fault:
        notes = "".join(f"\n{note}" for note in getattr(fault, "__notes__", ()))
        print(f"famjax: the test was stopped: {fault}{notes}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print(
            "famjax: stopped; a rig that ran has been vented, and its journal holds all until then",
            file=sys.stderr,
        )
        sys.exit(130)


@contextlib.contextmanager
def _signals_as_ctrl_c() -> Iterator[None]:
    """SIGTERM and SIGHUP end a command as Ctrl-C does: the rig is vented."""
    main = threading.current_thread() is threading.main_thread()
    numbers = [getattr(signal, name, None) for name in ("SIGTERM", "SIGHUP")] if main else []
    ours = [n for n in numbers if n is not None and signal.getsignal(n) is signal.SIG_DFL]
    for number in ours:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)
