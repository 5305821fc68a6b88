"""Before a test: greet the device, then send its transducer, its limits and its gains."""

from typing import Any

from ..calibration.whole_rig import Calibration
from ..errors import RigError
from ..fault import RigFault
from ..link.abstract_link import AbstractLink
from ..protocol.messages import PROTOCOL
from .limits_and_gains import RigSettings
from .tripped import refuse_tripped, unseen, watch_rest

HELLOS = 5
"""Times that a device is greeted: a board that was reset by opening its port starts in two seconds."""
_LOOK = 0.05


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


def set_up(link: AbstractLink, calibration: Calibration, settings: RigSettings) -> dict[str, Any]:
    """Send a device all that it controls with.

    Returns:
        What governs the test, for the journal: units in the keys.

    Raises:
        RigError: as `RigSettings.commands`, the device refuses it, it is tripped, or its transducer
            reads a pressure that does not vent.
        RigFault: it does not answer.
    """
    commands = settings.commands(calibration)
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
    hello, stored = session.hello, session.settings
    return settings.as_note(calibration) | {
        "unseen": tuple(unseen(calibration, alive=alive)),
        "trip_counts": stored.trip if stored else None,
        "jump_counts": stored.jump if stored else None,
        "gains_stored_counts_per_psi": stored.law.gains if stored else None,
        "hello": hello._asdict() if hello else None,
    }
