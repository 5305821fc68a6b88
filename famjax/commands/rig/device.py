"""Commands on a device at a port: list the ports, live values."""

from pathlib import Path
from typing import Literal

from rich.console import Console

from .asking import said_yes
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
    from rig.link import serial_opener

    from .monitor import Monitor

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


def rig_acknowledge(
    port: str,
    *,
    calibration: Path | None = None,
    baud: int = 115200,
    yes: bool = False,
) -> int:
    """Acknowledge a trip, after its cause was found; nothing else clears one.

    Shows why the device tripped, at which reading and output, and asks whether the cause was found.
    The device refuses while the pressure is at the limit or the reading out of range.

    Parameters
    ----------
    port
        A serial port or socket://host:port.
    calibration
        TOML file of the rig's sensors, for the reading in pressure; counts are shown without one.
    baud
        Of the firmware.
    yes
        Acknowledge without asking, for scripts.
    """
    from rig import Link, RigError, read_calibration
    from rig.control import acknowledge, device_status, trip_text
    from rig.link import serial_opener
    from rig.protocol import TRIP

    with rig_problems():
        known = None if calibration is None else read_calibration(calibration)
        with Link(serial_opener(port, baud)) as link:
            status = device_status(link)
            if status.state != TRIP:
                print("the device is not tripped")
                return 0
            print(f"tripped: {trip_text(status, known)}")
            if not yes and not said_yes("Was the cause found? Type yes to acknowledge: "):
                raise RigError("not acknowledged: the answer was not yes")
            acknowledge(link, known)
    print("acknowledged: the device is in SAFE, its dump valve open")
    return 0
