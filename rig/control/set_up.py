"""Before a test: greet the device, then send its transducer, its limits and its gains."""

import dataclasses
from typing import Any

from famjax.boundary.units import UNITS

from ..calibration.whole_rig import Calibration, calibration_as_dict
from ..errors import RigError
from ..fault import RigFault
from ..link.abstract_link import AbstractLink
from ..protocol.messages import PROTOCOL
from .settings import Control, Guards, device_calibration, jump_counts, trip_counts
from .tripped import refuse_tripped, unseen, watch_rest

HELLOS = 5
"""Times that a device is greeted: a board that was reset by opening its port starts in two seconds."""
_LOOK = 0.05
_PSI = UNITS["pressure"]["psi"]


def limit_commands(
    calibration: Calibration, pressure_limit: float, jump_limit: float, guards: Guards
) -> list[tuple[str, tuple[float, ...]]]:
    """The commands that set a device's transducer and limits.

    Raises:
        RigError: it cannot take the transducer, or a limit is missing or cannot be seen by it.
    """
    trip = trip_counts(calibration, pressure_limit)
    return [
        ("cal", device_calibration(calibration)),
        ("trip", (trip,)),
        ("jump", (jump_counts(calibration, jump_limit),)),
        *guards.commands(calibration, trip),
    ]


def greet(link: AbstractLink) -> None:
    """Wait for a device that speaks this protocol and sends records.

    Raises:
        RigError: it speaks another protocol.
        RigFault: there is none.
    """
    session = link.session
    for attempt in range(HELLOS):
        try:
            link.command("hello")
            link.command("strict", 1)
        except (RigFault, RigError):  # before that, a damaged command may be misunderstood
            if attempt == HELLOS - 1:
                raise
            continue
        link.sleep(4 * _LOOK)
        if session.hello is not None and link.newest is not None:
            break
    if session.hello is None or link.newest is None:
        raise RigFault("the device answers but sends no hello and records; is it famrig?")
    if session.hello.protocol != PROTOCOL:
        raise RigError(
            f"the device speaks protocol {session.hello.protocol}, this program {PROTOCOL}; upload "
            "the firmware that comes with it"
        )
    link.alarms.clear()  # opening the port may have reset the board


def set_up(
    link: AbstractLink,
    calibration: Calibration,
    control: Control,
    pressure_limit: float,
    jump_limit: float,
    guards: Guards,
) -> dict[str, Any]:
    """Send a device all that it controls with.

    Returns:
        What governs the test, for the journal: units in the keys.

    Raises:
        RigError: as `limit_commands`, the device refuses it, it is tripped, or its transducer reads
            a pressure that does not vent.
        RigFault: it does not answer.
    """
    commands = limit_commands(calibration, pressure_limit, jump_limit, guards)
    gains = control.proportional * _PSI, control.integral * _PSI
    commands += [("gain", gains), ("ilim", control.integral_limits)]
    link.command("stop")
    refuse_tripped(link, calibration)
    for verb, values in commands:
        link.command(verb, *values)
    session, until = link.session, link.now + 1.0
    while not session.settings_known:
        if link.now > until:
            raise RigFault("the device does not report its settings; check the cable")
        link.sleep(_LOOK)
    alive = watch_rest(link, calibration)
    hello, settings = session.hello, session.settings
    return {
        "pressure_limit_Pa": pressure_limit,
        "jump_limit_Pa": jump_limit,
        "guards": dataclasses.asdict(guards),
        "unseen": tuple(unseen(calibration, alive=alive)),
        "trip_counts": settings.trip if settings else None,
        "jump_counts": settings.jump if settings else None,
        "calibration": calibration_as_dict(calibration),
        "control": dataclasses.asdict(control),
        "gains_stored_counts_per_psi": settings.law.gains if settings else None,
        "hello": hello._asdict() if hello else None,
    }
