"""A test on a port from start to end, recorded; what ports there are."""

from collections.abc import Callable
from pathlib import Path

from ..calibration.whole_rig import Calibration, read_calibration
from ..errors import RigError
from ..journal.reader import read_journal
from ..journal.writer import Journal
from ..link.abstract_link import AbstractLink
from ..link.serial_link import Link, serial_opener
from .plan import duration, next_block
from .plan_file import PlanFile
from .plan_run import Machine, run
from .rig import Rig

JOURNAL = "test.fam"
"""Name of a test's journal in its folder."""


def ports() -> list[dict[str, str]]:
    """The serial ports of this computer: path to open, and description.

    A path under /dev/serial/by-id stays the same when a board is replugged.
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
        resume: continue the existing journal with the block that was not completed.
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
        append: continue the existing journal.
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
