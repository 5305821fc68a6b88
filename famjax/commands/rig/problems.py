"""How a problem of the rig ends a command."""

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def rig_problems() -> Iterator[None]:
    """Bad input of the rig as that of every command, and a rig that had to stop with exit code 1."""
    from fitting import InputError
    from rig import RigError, RigFault

    try:
        with _polite_ends():
            yield
    except RigError as error:
        raise InputError(str(error)) from None
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
def _polite_ends() -> Iterator[None]:
    """A closed terminal and a polite kill end a command as Ctrl-C does: vented, and said so."""
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
