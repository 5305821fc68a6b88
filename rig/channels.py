"""Check the device, its channels and its venting before and during a test."""

import math
import secrets
from collections import deque

from famjax.units import PSI

from .calibration import FULL_SCALE, READINGS, Calibration, pressure_text
from .errors import RigError, RigFault
from .link import AbstractLink, mean_counts
from .protocol import PROTOCOL, TRIP, DeviceStatus, Hello, Sample

LOOK = 0.05  # s between two looks at the device's state during a wait
HELLOS = 5  # times a device is greeted: a board that opening its port has reset starts in 2 s
LIVE_ZERO = 20  # least counts at 0 Pa of a transducer that has a floor: 0.1 V
FLOOR_SHARE = 0.6  # floor over the counts at 0 Pa: 0.3 V of 0.5 V
REST_PRESSURE = 3 * PSI  # a vented rig may still read it, up or down: offset and drift [Pa]
# From zero of the load cell at rest; beyond, it is dead, saturated or not tared.
REST_LOAD = 0.1 * FULL_SCALE
REST_TIME = 8.0  # s for which the reading is watched at rest at most; two seconds at rest suffice
_ALIVE = 2  # of `DeviceStatus.alive`

# The self-test, in counts of one conversion (about 4 per psi of a transducer of 200 psi).
TEST_RISE = 4.0  # of the pressure that is an answer to the first fluid
TEST_LOAD = 8.0  # of the load with which an answer of the pressure is due,
TEST_SHARE = 24  # at least so many times smaller
TEST_BEGIN = 2.5  # of either, with which the output goes on slowly
TEST_OUTPUT = 160  # greatest output: past the middle of a valve
TEST_TIME = 12.0  # s within which one of them has to move
TEST_RECORDS = 12  # in a mean

HELD = 1 * PSI  # from the set pressure, and one still counts as held: three times what is measured
WATCH_LOOKS = 20  # in a mean of the watch
WATCH_QUIET = 0.5  # counts from one mean to the next by which a load that rests moves
WATCH_TIMES = 4  # means in a row that contradict the muscle, and
WATCH_RISE = 15  # counts by which the load has to rise in them


def greet(link: AbstractLink) -> Hello:
    """Wait for a device that uses this protocol and sends records, and return its hello message.

    Raises:
        RigFault: no such device responds.
    """
    session = link.session
    for attempt in range(HELLOS):
        try:
            link.command("hello")
            link.command("strict", 1)
        except (RigFault, RigError):  # until then, a damaged command may be misread
            if attempt == HELLOS - 1:
                raise
            continue
        link.sleep(4 * LOOK)
        if session.hello is not None and link.newest is not None:
            break
    if session.hello is None or link.newest is None or session.hello.protocol != PROTOCOL:
        raise RigFault(f"the device must use protocol {PROTOCOL}: upload this version's firmware")
    link.alarms.clear()  # opening the port may have reset the board
    return session.hello


def numbered(link: AbstractLink) -> int:
    """Return the board's number; assign a random number if the board has none.

    Raises:
        RigFault: the device does not respond.
    """
    if not (board := greet(link).board):
        board = 1 + secrets.randbelow(65534)
        link.command("board", board)
    return board


def device_status(link: AbstractLink) -> DeviceStatus:
    """Return the device's state and, after a trip, its fault, reading and output.

    Raises:
        RigFault: the device does not respond.
    """
    link.command("status")
    link.sleep(2 * LOOK)
    if link.session.status is None:
        raise RigFault("the device responds but sends no status: check that it runs famrig")
    return link.session.status


def floor_counts(calibration: Calibration) -> int:
    """Return the lowest plausible reading of one conversion [counts], or 0 if no floor can be set.

    Gauge pressure is never far below zero. A transducer with a live zero therefore reads far below its
    value at 0 Pa only when it fails; the floor is 60 % of that value. A 0 to 5 V transducer reads 0 both
    at 0 Pa and with a broken wire.

    >>> from rig.simulation import load_cell, pressure_transducer
    >>> floor_counts(Calibration(pressure_transducer().calibration(), load_cell().calibration()))
    61
    """
    zero = calibration.pressure.zero / READINGS
    return math.floor(FLOOR_SHARE * zero) if zero >= LIVE_ZERO else 0


def watch_rest(link: AbstractLink, calibration: Calibration) -> bool:
    """Return True if the transducer's reading varies at rest, after venting.

    Raises:
        RigError: the transducer reads a pressure with the dump valve open, or the load cell is far from
            zero.
    """
    until = link.now + REST_TIME
    while True:
        link.keep_alive()
        counts, load = mean_counts(link, 0.5)
        status = device_status(link)
        pressure = float(calibration.pressure.value(counts))
        vented, late = abs(pressure) <= REST_PRESSURE, link.now > until
        if vented and (status.alive or late):
            break
        if late:
            raise RigError(
                f"the transducer reads {pressure_text(pressure, 'psi')} with the dump valve open: it is "
                "stuck, swapped with the load cell or miscalibrated, or the rig does not vent; compare "
                "the reading with a gauge"
            )
    if abs(load - calibration.force.zero) > REST_LOAD:
        raise RigError(
            f"the load cell reads {load / READINGS:.0f} counts with the dump valve open: it is dead, "
            "saturated or swapped with the transducer, or the muscle is loaded"
        )
    return status.alive == _ALIVE


def check_channels(link: AbstractLink) -> dict[str, float]:
    """Raise the output gradually until the pressure channel responds.

    Returns:
        The output, and the changes in pressure and load, in counts of one conversion.

    Raises:
        RigError: neither reading changes, or only the load changes, as happens if the channels are swapped.
    """
    seen = deque[Sample](maxlen=TEST_RECORDS)
    rest = mean_counts(link, 0.5)

    def moved(number: int) -> tuple[float, float]:
        """Return the changes in pressure and load since rest, averaged over the newest records."""
        some = list(seen)[-number:]
        sums = (s.pressure_sum for s in some), (s.force_sum for s in some)
        means = (math.fsum(one) / max(len(some), 1) for one in sums)
        rise, load = ((mean - zero) / READINGS for mean, zero in zip(means, rest, strict=True))
        return rise, abs(load)

    link.watch, until, output = seen.append, link.now + TEST_TIME, 0
    rise = load = 0.0
    try:
        while link.now < until and rise < TEST_RISE:
            link.keep_alive()
            link.command("man", output)
            link.sleep(0.02)
            link.check()
            if max(moved(4)) >= TEST_BEGIN:
                link.sleep(0.01 * TEST_RECORDS)
            rise, load = moved(TEST_RECORDS)
            tripped = link.newest is not None and link.newest.state == TRIP
            if tripped or (load >= TEST_LOAD and rise < load / TEST_SHARE):
                break
            output = min(output + 1, TEST_OUTPUT)
    finally:
        link.watch = None
        link.command("stop")
    if rise >= TEST_RISE:
        return {"output": output, "pressure_counts": rise, "force_counts": load}
    if load >= TEST_LOAD:
        raise RigError(
            "the load changed but the pressure did not: the channels are swapped, or the "
            "transducer's line is blocked; check the wires at A0 and A1"
        )
    raise RigError(
        f"an output of {output} counts changed neither the pressure nor the load: check for a missing "
        "supply, an open hose, a dump valve that stays open, or a tripped device"
    )


class FlowWatch:
    """Detect inflow that contradicts the readings while a pressure is held.

    A muscle that takes in fluid at constant pressure shortens and pulls less. A rising load then means
    that the pressure rises undetected, because of swapped channels or a blocked transducer line.
    """

    def __init__(self) -> None:
        self._outputs, self._loads = [], []
        self._reference, self._load, self._quiet = 0.0, math.nan, 0
        self._times, self._rise = 0, 0.0

    def contradicts(self, record: Sample, *, held: bool) -> bool:
        """Process a record; return True if the load has risen for several seconds during inflow."""
        if not held:
            self._outputs, self._loads, self._load = [], [], math.nan
            self._times, self._rise = 0, 0.0
            return False
        self._outputs.append(record.output)
        self._loads.append(record.force_sum / READINGS)
        if len(self._outputs) < WATCH_LOOKS:
            return False
        output, load = (math.fsum(x) / WATCH_LOOKS for x in (self._outputs, self._loads))
        rise, self._load = load - self._load, load
        self._outputs, self._loads = [], []
        if abs(rise) < WATCH_QUIET:  # steady: this output holds the pressure
            self._reference, self._quiet = max(self._reference, output), self._quiet + 1
        wrong = output > self._reference + 1 and rise >= WATCH_QUIET and self._quiet >= 3
        self._times, self._rise = (self._times + 1, self._rise + rise) if wrong else (0, 0.0)
        return self._times >= WATCH_TIMES and self._rise >= WATCH_RISE


def unseen(calibration: Calibration, *, alive: bool) -> list[str]:
    """Return the transducer faults that the device cannot detect, as sentences.

    Args:
        calibration: calibration of the transducer.
        alive: True if its reading varied at rest.
    """
    floor = "a broken transducer wire reads as 0 Pa and cannot be detected; use a 0.5 to 4.5 V transducer"
    frozen = "the reading hardly varies at rest, so a frozen reading near the set pressure is not detected"
    return [floor] * (not floor_counts(calibration)) + [frozen] * (not alive)
