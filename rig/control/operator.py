"""What the commands of `famjax rig` do, without their printing."""

import csv
from collections.abc import Callable, Iterable
from pathlib import Path

from ..calibration.whole_rig import Calibration, read_calibration
from ..errors import RigError
from ..journal.reader import read_journal
from ..journal.tables import table, write_netcdf, write_parquet
from ..journal.writer import Journal
from ..link.abstract_link import AbstractLink
from ..link.serial_link import Link, serial_opener
from .plan import duration, next_block
from .plan_file import PlanFile
from .plan_run import Machine, run
from .rig import Rig

JOURNAL = "test.fam"
"""Name of a test's journal in its folder."""

FORMATS = {".parquet": write_parquet, ".nc": write_netcdf}


def specimen_entries(entries: Iterable[str]) -> dict[str, str]:
    """Key and value of entries such as `wall_thickness_mm=1.6`.

    Raises:
        RigError: an entry that is not of this form, or a key twice.
    """
    found: dict[str, str] = {}
    for entry in entries:
        key, equals, value = (part.strip() for part in entry.partition("="))
        if not (key and equals and value) or key in found:
            raise RigError(
                f"specimen {entry!r} must read key_unit=value, once for each key, as in "
                "wall_thickness_mm=1.6"
            )
        found[key] = value
    return found


def ports() -> list[dict[str, str]]:
    """The serial ports of this computer: what to open, and what is plugged in.

    A path under /dev/serial/by-id stays the same when a board is plugged in anew.
    """
    from serial.tools import list_ports  # noqa: PLC0415 -- importing rig loads no serial library

    stable = {
        str(link.resolve()): str(link)
        for folder in [Path("/dev/serial/by-id")]
        if folder.is_dir()
        for link in folder.iterdir()
    }
    return [
        {"port": stable.get(port.device, port.device), "description": port.description}
        for port in sorted(list_ports.comports())
    ]


def need_port(port: str | None) -> str:
    """The port, or what there is to choose from.

    Raises:
        RigError: none is given.
    """
    if port is not None:
        return port
    known = ", ".join(f"{row['port']} ({row['description']})" for row in ports())
    raise RigError(
        f"which port? --port PORT; this computer has {known or 'none: plug the device in'}"
    )


def run_test(
    test: PlanFile,
    port: str,
    folder: str | Path,
    *,
    baud: int = 115200,
    resume: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> Path:
    """Carry out a test on a real rig and record it.

    Args:
        test: from its file.
        port: as `serial_opener` takes it.
        folder: for the journal.
        baud: of the firmware.
        resume: go on in the journal that is there, with the block that was not completed.
        progress: called about every second with the seconds done and the seconds planned.

    Returns:
        The journal.

    Raises:
        RigError: the test names no calibration, or as `Rig` and `run`.
        RigFault: the test had to stop; the rig is vented.
    """
    if test.calibration is None:
        raise RigError("[rig] must name a calibration, as in calibration = 'calibration.toml'")
    calibration = read_calibration(test.calibration)
    path = Path(folder) / JOURNAL
    path.parent.mkdir(parents=True, exist_ok=True)
    first = next_block(read_journal(path).notes) if resume else 0
    with Link(serial_opener(port, baud)) as link:
        record_test(
            test, link, calibration, path, first_block=first, append=resume, progress=progress
        )
    return path


def record_test(
    test: PlanFile,
    link: AbstractLink,
    calibration: Calibration,
    path: Path,
    *,
    machine: Machine | None = None,
    first_block: int = 0,
    append: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> None:
    """Carry out a test over a link, real or virtual, and record it.

    Args:
        test: plan, limits and gains.
        link: to the device.
        calibration: of its sensors.
        path: of the journal.
        machine: as for `run`.
        first_block: as for `run`.
        append: go on in the journal that is there.
        progress: as for `run`.

    Raises:
        RigError: as `Journal`, `Rig` and `run`.
        RigFault: the test had to stop; the rig is vented.
    """
    planned = duration(test.plan, first_block)
    with (
        Journal(path, lambda: link.now, append=append, plan_seconds=planned) as journal,
        Rig(
            link,
            calibration,
            pressure_limit=test.pressure_limit,
            control=test.control,
            jump_limit=test.jump_limit,
            journal=journal,
        ) as rig,
    ):
        run(rig, test.plan, machine=machine, first_block=first_block, progress=progress)


def convert(journal: str | Path, target: str | Path) -> Path:
    """The records of a journal as a table: Parquet, NetCDF or CSV, by the target's ending.

    Raises:
        RigError: another ending, or the journal cannot be read.
    """
    target = Path(target)
    record = read_journal(journal)
    if target.suffix in FORMATS:
        FORMATS[target.suffix](record, target)
        return target
    if target.suffix != ".csv":
        raise RigError(f"the target must end in {', '.join(FORMATS)} or .csv, got {target.name!r}")
    columns = table(record)
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return target
