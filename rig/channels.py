"""Checks before and under pressure: is this the device, are these its channels, does it vent?"""

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
    """Wait for a device with this protocol that sends records, and return its hello.

    Raises:
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
        link.sleep(4 * LOOK)
        if session.hello is not None and link.newest is not None:
            break
    if session.hello is None or link.newest is None or session.hello.protocol != PROTOCOL:
        raise RigFault(
            f"the device does not speak protocol {PROTOCOL}: upload the firmware of this program"
        )
    link.alarms.clear()  # opening the port may have reset the board
    return session.hello


def numbered(link: AbstractLink) -> int:
    """The number of the board; a board without one gets a random number.

    Raises:
        RigFault: it does not answer.
    """
    if not (board := greet(link).board):
        board = 1 + secrets.randbelow(65534)
        link.command("board", board)
    return board


def device_status(link: AbstractLink) -> DeviceStatus:
    """The device's state and, after a trip, its fault, reading and output.

    Raises:
        RigFault: it does not answer.
    """
    link.command("status")
    link.sleep(2 * LOOK)
    if link.session.status is None:
        raise RigFault("the device answers but sends no status; is it famrig?")
    return link.session.status


def floor_counts(calibration: Calibration) -> int:
    """Lowest plausible reading of one conversion [counts]; 0 if the transducer allows none.

    A gauge pressure is never far below zero, so a transducer whose 0 Pa lies above the converter's
    end reads less only when it fails: six tenths of its reading at 0 Pa. One of 0 to 5 V reads 0 at
    0 Pa and with a broken wire alike.

    >>> from rig.simulation import load_cell, pressure_transducer
    >>> floor_counts(Calibration(pressure_transducer().calibration(), load_cell().calibration()))
    61
    """
    zero = calibration.pressure.zero / READINGS
    return math.floor(FLOOR_SHARE * zero) if zero >= LIVE_ZERO else 0


def watch_rest(link: AbstractLink, calibration: Calibration) -> bool:
    """Whether the transducer's reading varies at rest, after it has vented.

    Raises:
        RigError: it reads a pressure although the dump valve is open, or the load cell is far from zero.
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
                "stuck, exchanged or wrongly calibrated, or the rig does not vent; compare with a gauge"
            )
    if abs(load - calibration.force.zero) > REST_LOAD:
        raise RigError(
            f"the load cell reads {load / READINGS:.0f} counts with the dump valve open: it is dead, "
            "saturated or exchanged, or the muscle is loaded"
        )
    return status.alive == _ALIVE


def check_channels(link: AbstractLink) -> dict[str, float]:
    """Let in the first fluid gradually; the pressure channel must respond.

    Returns:
        The output, and by how many counts of one conversion pressure and load have moved.

    Raises:
        RigError: the load moves and the pressure does not, as with exchanged channels, or neither.
    """
    seen = deque[Sample](maxlen=TEST_RECORDS)
    rest = mean_counts(link, 0.5)

    def moved(number: int) -> tuple[float, float]:
        """Pressure and load of the newest records, against rest."""
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
            "the first fluid moved the load and not the pressure: the channels are exchanged, or the "
            "transducer's line is blocked; check the wires at A0 and A1"
        )
    raise RigError(
        f"an output of {output} counts moved neither pressure nor load: no supply, an open hose, a dump "
        "valve that stays open, or a device that has tripped"
    )


class FlowWatch:
    """Watch whether the flow into a muscle contradicts the readings at a held pressure.

    A muscle that takes in fluid at a constant pressure shortens, and pulls less. A load that rises then
    belongs to a pressure that rises unseen: channels are exchanged, or the transducer's line is blocked.
    """

    def __init__(self) -> None:
        self._outputs, self._loads = [], []
        self._reference, self._load, self._quiet = 0.0, math.nan, 0
        self._times, self._rise = 0, 0.0

    def contradicts(self, record: Sample, *, held: bool) -> bool:
        """Look at a record; true when the load has risen for some seconds while fluid flowed in."""
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
        if abs(rise) < WATCH_QUIET:  # nothing moves: this output holds the pressure
            self._reference, self._quiet = max(self._reference, output), self._quiet + 1
        wrong = output > self._reference + 1 and rise >= WATCH_QUIET and self._quiet >= 3
        self._times, self._rise = (self._times + 1, self._rise + rise) if wrong else (0, 0.0)
        return self._times >= WATCH_TIMES and self._rise >= WATCH_RISE


def unseen(calibration: Calibration, *, alive: bool) -> list[str]:
    """Transducer faults that the device cannot detect, one sentence each.

    Args:
        calibration: of the transducer.
        alive: whether its reading varied at rest.
    """
    floor = "the transducer cannot have a floor: its broken wire reads like 0 Pa; take one of 0.5 to 4.5 V"
    frozen = (
        "the reading hardly varies at rest: one that freezes close to the set pressure is not seen"
    )
    return [floor] * (not floor_counts(calibration)) + [frozen] * (not alive)
