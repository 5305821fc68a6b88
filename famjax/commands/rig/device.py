"""Commands on a device at a port: list the ports, live values, a test."""

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from ..options.entries import parse_entries
from ..terminal import progress_bar
from .problems import rig_problems


def rig_ports() -> int:
    """List the serial ports of this computer."""
    from rig.control import ports

    found = ports()
    for row in found:
        print(f"{row['port']}  {row['description']}")
    if not found:
        print("no serial port; plug the device in, or give socket://host:port")
    return 0


def rig_monitor(
    port: str,
    *,
    calibration: Path | None = None,
    baud: int = 115200,
    seconds: float | None = None,
    units: Literal["si", "metric", "us"] = "us",
) -> int:
    """Show live values and a plot of the pressure; sends nothing that changes the device.

    Opening the port resets most boards, which then vent. In a terminal the picture is redrawn;
    elsewhere a line is printed every second.

    Parameters
    ----------
    port
        A serial port or socket://host:port.
    calibration
        TOML file of the rig's sensors; counts are shown without one.
    baud
        Of the firmware: 115200 (an Uno is 2.1 % fast then), 500000 (exact), or what it was built for.
    seconds
        Duration; until Ctrl-C unless given.
    units
        Of the values: si, metric or us.
    """
    from time import monotonic

    from rich.live import Live
    from rich.text import Text

    from rig import Link, read_calibration
    from rig.control import Monitor
    from rig.link import serial_opener

    with rig_problems():
        view = Monitor(read_calibration(calibration) if calibration else None, units)
        link = Link(serial_opener(port, baud))
        link.watch = view.add
        end = None if seconds is None else monotonic() + seconds
        console = Console()
        try:
            with Live(console=console, auto_refresh=False, transient=True) as live:
                while end is None or monotonic() < end:
                    link.sleep(0.2 if console.is_terminal else 1.0)
                    settings = link.session.settings
                    view.ticks_per_record = settings.ticks_per_record if settings else 5
                    if console.is_terminal:
                        live.update(Text(f"{view.line()}\n{view.plot()}"), refresh=True)
                    else:
                        print(view.line(), flush=True)
        finally:
            link.close()
    return 0


def rig_run(
    plan: Path,
    *,
    port: str | None = None,
    baud: int = 115200,
    output: Path = Path("famjax-rig"),
    resume: Annotated[bool, Parameter(negative=())] = False,
    dry_run: Annotated[bool, Parameter(negative=())] = False,
    yes: Annotated[bool, Parameter(negative=())] = False,
    meta: Annotated[tuple[str, ...], Parameter(negative=())] = (),
) -> int:
    """Carry out a test at constant pressures and record it; the rig vents however this ends.

    First prints what software cannot check, relief valve and dump valve, and asks for a
    confirmation. Writes `test.fam` into the output folder. At each pressure it says with the
    measured pressure when to start the test machine's strokes.

    Parameters
    ----------
    plan
        TOML file with the tables [plan] and [rig]; a pressure limit is needed.
    port
        A serial port or socket://host:port.
    baud
        Of the firmware: 115200 (an Uno is 2.1 % fast then), 500000 (exact), or what it was built for.
    output
        Folder for the journal, made if need be.
    resume
        Continue the existing journal with the pressure that was not completed; only with the same
        plan, limits, gains and calibration.
    dry_run
        Print the steps of the plan and how long they last, and end.
    yes
        Start without asking, for scripts.
    meta
        An entry of the journal, `operator=NAME`, repeatable.
    """
    from rig import read_plan
    from rig.control import PRECONDITIONS, describe, duration, prepare, run_test

    with rig_problems():
        test = read_plan(plan)
        entries = parse_entries(meta, "meta", "operator=NAME")
        print(
            f"Circuit of {test.circuit}, limit {test.pressure_limit / 1e3:.4g} kPa "
            f"({test.pressure_limit / 6894.757:.4g} psi). Make sure that:"
        )
        for sentence in PRECONDITIONS[test.circuit]:
            print(f"- {sentence}")
        port = port if dry_run else _known_port(port)
        _, first = prepare(test, output, resume=resume)
        if port is None or dry_run:
            print(*describe(test.plan, first), sep="\n")
            print(f"lasts {_clock(duration(test.plan, first))}, besides the device's answers")
            return 0
        if not yes:
            _confirm(f"{_clock(duration(test.plan, first))} of strokes and rests")
        with progress_bar() as progress:
            task = progress.add_task("running the plan", total=None)
            path = run_test(
                test,
                port,
                output,
                baud=baud,
                resume=resume,
                meta=entries,
                progress=lambda done, total: progress.update(task, completed=done, total=total),
                tell=lambda text: print(text, flush=True),
            )
    print("written:", path)
    return 0


def _clock(seconds: float) -> str:
    """A duration as a person says it."""
    minutes, left = divmod(round(seconds), 60)
    return f"{seconds:.0f} s ({minutes} min {left} s)" if minutes else f"{seconds:.0f} s"


def _confirm(what: str) -> None:
    """Ask whether to start, and end the command unless the answer is yes."""
    from rig import RigError

    if not sys.stdin.isatty():
        raise RigError(
            "a run waits for a person's yes, and standard input is no terminal: in a script, whose "
            "author answers for all of the above, give --yes"
        )
    if input(f"{what}. Type yes to pressurise the muscle: ").strip().lower() != "yes":
        raise RigError("not started: the answer was not yes")


def _known_port(port: str | None) -> str:
    """The port, or an error that lists what there is to choose from."""
    from rig import RigError
    from rig.control import ports

    if port is not None:
        return port
    known = ", ".join(f"{row['port']} ({row['description']})" for row in ports())
    raise RigError(
        f"which port? --port PORT; this computer has {known or 'none: plug the device in'}"
    )
