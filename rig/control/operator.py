"""A test from start to end, recorded, and whether it may go on; what ports there are."""

import datetime
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..calibration.whole_rig import Calibration, read_calibration
from ..errors import RigError
from ..journal.reader import Record, read_journal
from ..journal.writer import Journal
from ..link.abstract_link import AbstractLink
from .attendant import Attendant, Start
from .limits_and_gains import check_feed_forward
from .plan import duration, next_block
from .plan_file import PlanFile
from .plan_run import Machine, check_plan, run
from .rig import Rig

JOURNAL = "test.fam"
"""Name of a test's journal in its folder."""
_FIELD = re.compile(r"(\w+)=(.*?)(?=, \w+=|\)$)")


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


def prepare(
    test: PlanFile,
    folder: str | Path,
    *,
    resume: bool = False,
    camera: Callable[[str], None] | None = None,
) -> tuple[Calibration, int]:
    """All that can be refused before a port is opened; nothing is written.

    Args:
        test: from its file.
        folder: of the journal.
        resume: continue the journal there.
        camera: takes the photographs of the plan.

    Returns:
        The calibration, and the block with which the test begins.

    Raises:
        RigError: the test names no calibration, or photographs and there is no camera; the limits
            or a pressure cannot be; the journal there is of another test.
    """
    if test.calibration is None:
        raise RigError("[rig] must name a calibration, as in calibration = 'calibration.toml'")
    if test.plan.photograph_every and camera is None:
        raise RigError(
            f"[plan]: photograph_every_s = {test.plan.photograph_every:g} needs a camera: --camera "
            "with the command that takes a photograph, or leave the key out and trigger the camera "
            "yourself"
        )
    calibration = read_calibration(test.calibration)
    record = read_journal(Path(folder) / JOURNAL) if resume else None
    first = 0 if record is None else resumed_block(record, test, calibration)
    _check(test, calibration, first)
    return calibration, first


def _check(test: PlanFile, calibration: Calibration, first_block: int) -> None:
    check_feed_forward(test.circuit, calibration)
    test.settings.commands(calibration)
    check_plan(test.plan, calibration, test.pressure_limit, first_block)


def record_test(
    test: PlanFile,
    link: AbstractLink,
    calibration: Calibration,
    path: Path,
    *,
    machine: Machine | None = None,
    first_block: int = 0,
    append: bool = False,
    meta: Mapping[str, str] | None = None,
    attendant: Attendant | None = None,
    start: Start = "at once",
    camera: Callable[[str], None] | None = None,
    began: datetime.datetime | None = None,
) -> None:
    """Carry out a test over a link, real or virtual, and record it.

    A test that is refused leaves no journal behind.

    Args:
        test: plan, limits and gains.
        link: to the device.
        calibration: of its sensors.
        path: of the journal.
        machine: as for `run`.
        first_block: as for `run`.
        append: continue the existing journal.
        meta: further entries of the journal.
        attendant: as for `run`.
        start: as for `run`.
        camera: called with a name to take a photograph, or None.
        began: date of a simulated test; now if None.

    Raises:
        RigError: as `Journal`, `Rig` and `run`.
        RigFault: the test had to stop; the rig is vented.
    """
    _check(test, calibration, first_block)
    planned = duration(test.plan, first_block)
    empty = False
    try:
        with Journal(
            path, lambda: link.now, append=append, plan_seconds=planned, began=began
        ) as journal:
            empty = not append
            if meta:
                journal.note("meta", entries=dict(meta))
            with Rig(
                link, calibration, pressure_limit=test.pressure_limit, control=test.control,
                jump_limit=test.jump_limit, guards=test.guards, journal=journal, camera=camera,
            ) as rig:  # fmt: skip
                empty = False
                if attendant is not None:
                    for sentence in rig.unseen:
                        attendant.tell(f"note: {sentence}")
                run(
                    rig, test.plan, machine=machine, first_block=first_block,
                    attendant=attendant, start=start,
                )  # fmt: skip
    except RigError:
        if empty:  # the device refused the test: nothing has run
            path.unlink()
        raise


def resumed_block(record: Record, test: PlanFile, calibration: Calibration) -> int:
    """The block with which a test goes on in the journal that it began.

    Raises:
        RigError: what differs from the test that the journal holds, or it is complete.
    """
    apart = _plan_differences(record, repr(test.plan))
    for note in record.notes_of("rig")[-1:]:
        apart += _differences(note, json.loads(json.dumps(test.settings.as_note(calibration))))
    if apart:
        raise RigError(
            f"{record.path} cannot be resumed with another test: {'; '.join(apart)}. Restore what it "
            "was begun with, or record into another folder"
        )
    block = next_block(record.notes)
    if block >= len(test.plan.pressures):
        raise RigError(f"{record.path} is complete: nothing is left to resume")
    return block


def _plan_differences(record: Record, plan: str) -> list[str]:
    for note in record.notes_of("plan")[-1:]:
        if note["plan"] != plan:
            before, after = (dict(_FIELD.findall(text)) for text in (note["plan"], plan))
            return _differences(before, after) or [f"the plan was {note['plan']}, is {plan}"]
    return []


def _differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """What has another value, a name and both values each; of tables the entries that have."""
    found = []
    for name, value in after.items():
        old = before.get(name)
        if isinstance(value, dict) and isinstance(old, dict):
            found += [f"{name}: {one}" for one in _differences(old, value)]
        elif old != value:
            found.append(f"{name} was {old}, is {value}")
    return found
