"""A device before its first pressure: whether it is tripped, and whether its transducer is alive."""

from famjax.boundary.units import UNITS

from ..calibration.sensor import READINGS
from ..calibration.whole_rig import Calibration
from ..errors import RigError
from ..fault import ADVICE, RigFault
from ..link.abstract_link import AbstractLink
from ..protocol.messages import FAULTS, TRIP, DeviceStatus
from .limits_and_gains import floor_counts

_PSI = UNITS["pressure"]["psi"]
REST_PRESSURE = 5 * _PSI
"""Reading [Pa], up or down, that a vented rig may still have: offset and drift of a transducer."""
REST_TIME = 8.0
"""Longest time [s] for which the reading is watched at rest; two seconds at rest suffice."""
_LOOK = 0.1
_ALIVE = 2


def refuse_tripped(link: AbstractLink, calibration: Calibration | None = None) -> None:
    """Nothing where the device is not tripped; this program never acknowledges a trip by itself.

    Raises:
        RigError: it is: why, at which reading and output, and what to do.
    """
    status = device_status(link)
    if status.state == TRIP:
        raise RigError(
            f"the device is tripped: {trip_text(status, calibration)}. Find the cause, then "
            "acknowledge the trip: `famjax rig acknowledge PORT`"
        )


def device_status(link: AbstractLink) -> DeviceStatus:
    """The device's state and, of a trip, its fault, reading and output.

    Raises:
        RigFault: it does not answer.
    """
    link.command("status")
    link.sleep(_LOOK)
    status = link.session.status
    if status is None:
        raise RigFault("the device answers but sends no status; is it famrig?")
    return status


def acknowledge(link: AbstractLink, calibration: Calibration | None = None) -> None:
    """Clear a trip, because a person has found its cause.

    Args:
        link: to the device.
        calibration: of its transducer; a device that was reset has forgotten the floor of one of
            0 to 5 V.

    Raises:
        RigError: the device refuses: the pressure is still at the limit, or the reading is out of
            range, or it runs.
        RigFault: it does not answer.
    """
    if calibration is not None:
        link.command("floor", floor_counts(calibration))
    link.command("clear")


def trip_text(status: DeviceStatus, calibration: Calibration | None = None) -> str:
    """A trip as the device reports it: fault, reading, output, and what to check.

    >>> trip_text(DeviceStatus(1, 9, 45, 3, 6, 0, 0, 0, 0, 0, 0, 40, 12, 131))
    'range at 12 counts, output 131; the reading was outside floor and ceiling: a broken wire, a \
short, an unplugged transducer or one without supply'
    """
    fault = FAULTS[status.fault]
    return f"{fault}{at_trip(status, calibration)}; {ADVICE.get(fault, '')}"


def at_trip(status: DeviceStatus, calibration: Calibration | None = None) -> str:
    """Reading and output at the trip: ' at 563 counts (112.4 psi), output 131'."""
    reading = f"{status.tripped_count} counts"
    if calibration is not None:
        pressure = float(calibration.pressure.value(READINGS * status.tripped_count))
        reading += f" ({pressure / _PSI:.4g} psi)"
    return f" at {reading}, output {status.tripped_output}"


def watch_rest(link: AbstractLink, calibration: Calibration) -> bool:
    """Whether the transducer's reading varies at rest, after it has vented.

    Raises:
        RigError: it reads a pressure although the dump valve is open.
    """
    until = link.now + REST_TIME
    while True:
        link.kick()
        link.command("status")
        link.sleep(_LOOK)
        status, newest = link.session.status, link.newest
        settings = link.session.settings
        if newest is None or settings is None or status is None:
            continue
        counts = newest.pressure_sum * READINGS / settings.ticks_per_record
        pressure = float(calibration.pressure.value(counts))
        vented = abs(pressure) <= REST_PRESSURE
        if link.now > until and not vented:
            raise RigError(
                f"the transducer reads {pressure / 1e3:.4g} kPa ({pressure / _PSI:.3g} psi) with the "
                "dump valve open: it is stuck, its calibration is not this one's, or the rig does "
                "not vent; compare it with a gauge"
            )
        if vented and (status.alive or link.now > until):
            return status.alive == _ALIVE


def unseen(calibration: Calibration, *, alive: bool) -> list[str]:
    """Faults of this transducer that the device cannot detect, one sentence each.

    Args:
        calibration: of the transducer.
        alive: whether its reading varied at rest.
    """
    found = []
    if not floor_counts(calibration):
        found.append(
            "the transducer reads no counts at 0 Pa, so that it cannot have a floor: a broken wire "
            "reads like 0 Pa; one of 0.5 to 4.5 V is better"
        )
    if not alive:
        found.append(
            "the reading hardly varies at rest, so that one that freezes close to the set pressure "
            "cannot be distinguished from a quiet one"
        )
    return found
