"""The group of commands, and how a problem of the rig ends one."""

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator

from cyclopts import App

from ..app import app

HELP = """Control a muscle's pressure, record a test, or simulate both; see rig/firmware.

PLAN.toml, units in the keys (psi, kPa, bar, in, mm, ...):

```toml
[plan]
pressures_psi = [20, 40, 60, 80, 100]
cycles = 3
stroke_in = 3.4
rate_in_per_s = 0.04
settle_s = 10
# photograph_every_s = 1

[rig]
circuit = "air"                       # or "water"
pressure_limit_psi = 110              # trips; without it nothing runs
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
calibration = "calibration.toml"      # of the sensors; `simulate` needs none
# jump_limit_psi = 15                 # a change in 10 ms that trips
# integral_limits_counts = [-128, 128]
```
"""

rig_app = App(name="rig", help=HELP, help_format="markdown")
app.command(rig_app)


@contextlib.contextmanager
def rig_problems() -> Iterator[None]:
    """Bad input of the rig as that of every command, and a rig that had to stop with exit code 1."""
    from fitting import InputError  # noqa: PLC0415
    from rig import RigError, RigFault  # noqa: PLC0415

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
