"""The command of a test on a rig: what it asks, shows, and leaves."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ..keys import has_keys
from ..options.entries import parse_entries
from .asking import confirm, known_port, tell_preconditions
from .problems import rig_problems

if TYPE_CHECKING:
    from rig.control import Plan, Start

    from .camera_command import CameraCommand


def rig_run(
    plan: Path,
    *,
    port: str | None = None,
    baud: int = 115200,
    output: Path = Path("famjax-rig"),
    resume: bool = False,
    dry_run: bool = False,
    yes: bool = False,
    meta: tuple[str, ...] = (),
    start: Literal["asked", "load", "at-once"] | None = None,
    camera: str | None = None,
    units: Literal["si", "metric", "us"] = "us",
) -> int:
    """Carry out a test at constant pressures and record it; the rig vents however this ends.

    First prints what software cannot check, relief valve and dump valve, and asks for a
    confirmation. Writes `test.fam` into the output folder. At each pressure it says with the
    measured pressure when to start the test machine's strokes, and waits for them. In a terminal it
    shows pressure, force, stroke and the time that is left, and takes keys: Enter when the strokes
    have begun, p to pause with the pressure held, s to skip a pressure, r to repeat it.

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
    start
        When strokes count as begun: `asked`, when Enter is pressed; `load`, when the force at the
        load cell changes; `at-once`, when they are asked for, as without a terminal.
    camera
        Command that takes a photograph, `{name}` in it for its name; for photograph_every_s.
    units
        Of the values: si, metric or us.
    """
    from rig import Link, read_plan
    from rig.control import JOURNAL, duration, prepare, record_test
    from rig.link import serial_opener

    from .attended import attended, clock
    from .camera_command import CameraCommand

    with rig_problems():
        test = read_plan(plan)
        entries = parse_entries(meta, "meta", "operator=NAME")
        tell_preconditions(test)
        port = port if dry_run else known_port(port)
        photographer = None if camera is None else CameraCommand(camera)
        calibration, first = prepare(test, output, resume=resume, camera=photographer)
        if port is None or dry_run:
            print(*describe(test.plan, first), sep="\n")
            print(f"lasts {clock(duration(test.plan, first))}, besides the device's answers")
            return 0
        confirm(f"{clock(duration(test.plan, first))} of strokes and rests", yes=yes)
        with attended(calibration, units) as attendant:
            output.mkdir(parents=True, exist_ok=True)
            with Link(serial_opener(port, baud)) as link:
                record_test(
                    test, link, calibration, output / JOURNAL, first_block=first, append=resume,
                    meta=entries, attendant=attendant, start=_start(start), camera=photographer,
                )  # fmt: skip
    _report_photographs(photographer)
    print("written:", output / JOURNAL)
    return 0


def _start(asked: str | None) -> "Start":
    """When strokes count as begun; who cannot press a key is not waited for."""
    from rig import RigError

    if asked == "asked" and not has_keys():
        raise RigError("--start asked waits for a key, and here is no terminal: load or at-once")
    known: dict[str | None, Start] = {"asked": "asked", "load": "load", "at-once": "at once"}
    return known.get(asked, "asked" if has_keys() else "at once")


def _report_photographs(camera: "CameraCommand | None") -> None:
    """Say which photographs were not taken."""
    if camera is None:
        return
    camera.close()
    print(f"photographs: {camera.taken}, of which {len(camera.failed)} failed")
    for name, why in camera.failed.items():
        print(f"- {name}: {why}", file=sys.stderr)


def describe(plan: "Plan", first_block: int = 0) -> list[str]:
    """One line for each step with the time at which it begins, units in the line; nothing is run.

    >>> from rig.control import Isobaric
    >>> describe(Isobaric((1e5,), cycles=1, stroke=0.0625, rate=0.0009765625, settle=5.0))[:3]
    ['     0.0 s  block 0: 100000 Pa', '     0.0 s  set 100000 Pa', '     0.0 s  wait 5 s']
    """
    from rig.control import seconds_of

    texts = {
        "block": "block {1}: {2:.0f} Pa",
        "set": "set {1:.0f} Pa",
        "wait": "wait {1:g} s",
        "strokes": "{2} cycles, {3:g} s: stroke {4:g} m at {5:g} m/s",
        "trigger": "trigger {1}",
        "note": "note {1} {2}",
        "done": "block {1} is complete",
    }
    at, lines = 0.0, []
    for step in plan.steps(first_block):
        lines.append(f"{at:8.1f} s  {texts[step[0]].format(*step)}")
        at += seconds_of(step)
    return lines
