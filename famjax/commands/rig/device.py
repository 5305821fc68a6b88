"""Commands on a device at a port: list the ports, live values, a test."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

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
) -> int:
    """Carry out a test at constant pressures and record it; the rig vents however this ends.

    First prints what software cannot check: relief valve, dump valve. Writes
    `test.fam` into the output folder. Start the test machine's strokes when the pressure is held.

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
        Continue the existing journal with the pressure that was not completed.
    """
    from rig import read_plan
    from rig.control import PRECONDITIONS, run_test

    with rig_problems():
        test = read_plan(plan)
        print(
            f"Circuit of {test.circuit}, limit {test.pressure_limit / 1e3:.4g} kPa "
            f"({test.pressure_limit / 6894.757:.4g} psi). Make sure that:"
        )
        for sentence in PRECONDITIONS[test.circuit]:
            print(f"- {sentence}")
        with progress_bar() as progress:
            task = progress.add_task("running the plan", total=None)
            path = run_test(
                test,
                _known_port(port),
                output,
                baud=baud,
                resume=resume,
                progress=lambda done, total: progress.update(task, completed=done, total=total),
            )
    print("written:", path)
    return 0


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
