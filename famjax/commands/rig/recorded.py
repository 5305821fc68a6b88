"""Commands on a journal: replay, check, convert."""

import json
from pathlib import Path
from typing import Literal

from rich.console import Console

from .problems import rig_problems


def rig_replay(
    journal: Path,
    *,
    speed: float = 10.0,
    units: Literal["si", "metric", "us"] = "us",
) -> int:
    """Show a recorded test as `monitor` would have, faster.

    Parameters
    ----------
    journal
        The journal.
    speed
        Seconds of the test per second; 0 prints a line for every second of the test at once.
    units
        Of the values: si, metric or us.
    """
    from time import sleep

    from rich.live import Live
    from rich.text import Text

    from rig import read_journal
    from rig.journal import stored_calibration
    from rig.protocol import Sample

    from .monitor import Monitor

    with rig_problems():
        record = read_journal(journal)
        view = Monitor(stored_calibration(record), units)
        console = Console()
        drawn = console.is_terminal and speed > 0
        with Live(console=console, auto_refresh=False, transient=True) as live:
            for k, row in enumerate(record.rows.tolist()):
                view.add(Sample(*row))
                if drawn and k % 20 == 0:
                    live.update(Text(f"{view.line()}\n{view.plot()}"), refresh=True)
                    sleep(0.2 / speed)
                elif not drawn and k % 100 == 0:
                    print(view.line())
                    if speed > 0:
                        sleep(1.0 / speed)
    print(view.line())
    return 0


def rig_check(
    journal: Path,
    *,
    json_: bool = False,
) -> int:
    """Check a journal: is it whole, what was lost, did the device do what its law says?

    Exit code 0 when it is sound, 1 when it is not; records that the line lost are listed and do not
    make it unsound.

    Parameters
    ----------
    journal
        The journal.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    from dataclasses import asdict

    from rig import audit, read_journal

    with rig_problems():
        found = audit(read_journal(journal))
    print(json.dumps(asdict(found) | {"sound": found.sound}) if json_ else found)
    return 0 if found.sound else 1


def rig_convert(journal: Path, target: Path) -> int:
    """Write a journal's records as a table with units; the journal stays the record.

    Parameters
    ----------
    journal
        The journal.
    target
        File to write: .parquet, .nc (NetCDF) or .csv.
    """
    from famjax.chain.journals import convert

    with rig_problems():
        print("written:", convert(journal, target))
    return 0
