"""Pressure control with limits, gains and guards; the rig always vents at the end of a test.

Use `Rig` in a `with` block. A pressure limit is required, only a person may acknowledge a trip, and the
heartbeats continue only while the supervising code runs.
"""

import dataclasses
import math
from typing import Any, NoReturn, Self

from famjax.units import PSI

from .calibration import READINGS, Calibration, calibration_as_dict, pressure_text
from .channels import (
    HELD,
    LOOK,
    REST_PRESSURE,
    FlowWatch,
    check_channels,
    device_status,
    floor_counts,
    greet,
    unseen,
    watch_rest,
)
from .controller import DeviceControl, Latch
from .device import read_numbers
from .errors import RigError, RigFault
from .journal import Journal
from .link import AbstractLink, Lost, Reset, Silent
from .protocol import (
    DRIVEN,
    FAULTS,
    RUN,
    STATES,
    TICK_HZ,
    TRIP,
    DeviceSettings,
    DeviceStatus,
    Hello,
    Sample,
    command_body,
)

JUMP_LIMIT = 15 * PSI  # pressure change within five ticks (10 ms) that trips [Pa]
LEAST_JUMP = 5  # counts, above noise of a count or two
SETTLE = 0.7  # s for which the device keeps its last records
# Fixed settings: silence before venting; ticks per record; highest plausible reading, 4.7 V, beyond any
# 0.5 to 4.5 V transducer; time without variation that trips.
SILENCE_MS, TICKS_PER_RECORD, CEILING, STILL_MS = 1000, 5, 963, 700
# What to check after each fault.
ADVICE = {
    "none": "another program has stopped the device",
    "silence": "the device received no line for a second; check the cable and the load on this computer",
    "over-pressure": "the pressure limit was reached, or the transducer is unplugged or has no supply",
    "jump": "the pressure jumped within 10 ms: a muscle or hose burst, the transducer is failing, or a "
    "small muscle filled quickly; only in the last case, raise jump_limit_<unit> in the plan's [rig]",
    "stall": "the pressure did not rise at full output; check the supply, hose, muscle and transducer",
    "watchdog": "the device's firmware hung; check its power supply",
    "range": "check for a broken wire, a short circuit, and an unplugged or unpowered transducer",
    "frozen": "the reading did not follow the output: check the transducer and its line first, since the "
    "true pressure may be higher than the reading",
    "no response": "the pressure did not follow the output: check for a blocked transducer line, a missing "
    "supply or an open circuit; if the circuit is merely slow, raise frozen_s in the plan's [rig]",
}


@dataclasses.dataclass(frozen=True)
class Control:
    """Gains of the pressure controller, u = v + Kp e + Ki int e dt, in counts of pulse-width modulation.

    Attributes:
        proportional: Kp [counts/Pa], >= 0. The device stores it in steps of 1/256 count per psi.
        integral: Ki [counts/(Pa s)], >= 0, stored in steps of 1/256 count per psi and second.
        integral_limits: lower and upper limit of the integral term [counts], within -255..0 and 0..255.
            The published pressures can be held with symmetric limits, but not with limits of 0..255.
    """

    proportional: float
    integral: float
    integral_limits: tuple[int, int] = (-128, 128)

    @classmethod
    def per_psi(cls, proportional: float, integral: float) -> Self:
        """Return gains from values in counts/psi and counts/(psi s), as used in the reference work."""
        return cls(proportional / PSI, integral / PSI)


@dataclasses.dataclass(frozen=True)
class RigSettings:
    """Control and trip settings of a device; `firmware/README.md` explains why they are needed.

    Attributes:
        pressure_limit: pressure at which the device trips [Pa gauge]; required.
        control: controller gains.
        jump_limit: pressure change within 10 ms that trips the device [Pa]. A failing transducer jumps, but
            so does the pressure in a small muscle filled through a large valve; such a muscle needs a
            higher limit, which offers less protection.
        frozen_output: PWM counts, 1 to 255, by which the output may exceed the holding output; 255 disables
            the check.
        frozen: time [s], 0.1 to 2, after which the device trips if the output is at twice that excess and
            the reading does not change.
        stall: time [s], 0.5 to 30, after which the device trips if the output or the integral is at its
            upper limit and the pressure does not rise.
        unit: pressure unit in messages.
    """

    pressure_limit: float
    control: Control
    jump_limit: float = JUMP_LIMIT
    frozen_output: int = 4
    frozen: float = 0.75
    stall: float = 3.0
    unit: str = "kPa"

    def commands(self, calibration: Calibration) -> list[tuple[str, tuple[float, ...]]]:
        """Return the commands for these settings and the transducer.

        Raises:
            RigError: the transducer is not supported, or a limit is missing or outside its range.
        """
        gains, frozen = self.control, (self.frozen_output, round(1000 * self.frozen))
        ranges = {
            "frozen_output": (1, 255, "counts"), "frozen": (0.1, 2, "s"), "stall": (0.5, 30, "s")
        }  # fmt: skip
        for name, (low, high, unit) in ranges.items():
            if not low <= (value := getattr(self, name)) <= high:
                raise RigError(
                    f"{name} must be between {low} and {high} {unit}, got {value:g} {unit}"
                )
        return [
            ("hbms", (SILENCE_MS,)),
            ("tele", (TICKS_PER_RECORD,)),
            ("cal", _device_calibration(calibration)),
            ("trip", (self._trip_counts(calibration),)),
            ("jump", (self._jump_counts(calibration),)),
            ("floor", (floor_counts(calibration),)),
            ("ceiling", (CEILING,)),
            ("still", (STILL_MS,)),
            ("frozen", frozen),
            ("stall", (round(1000 * self.stall),)),
            ("gain", (gains.proportional * PSI, gains.integral * PSI)),
            ("ilim", gains.integral_limits),
        ]

    def as_note(self, calibration: Calibration) -> dict[str, Any]:
        """Return the settings for the journal, with units in the keys."""
        return {
            "pressure_limit_Pa": self.pressure_limit,
            "jump_limit_Pa": self.jump_limit,
            "frozen_output_counts": self.frozen_output,
            "frozen_s": self.frozen,
            "stall_s": self.stall,
            "control": dataclasses.asdict(self.control),
            "calibration": calibration_as_dict(calibration),
        }

    def _trip_counts(self, calibration: Calibration) -> int:
        """Return the pressure limit in counts of one reading, rounded down."""
        limit: float | None = self.pressure_limit
        if limit is None or not math.isfinite(limit) or limit <= 0:
            raise RigError(
                f"the pressure limit must be finite and > 0, got {limit}: use the muscle's rated pressure"
            )
        counts = int(calibration.pressure.counts(limit) // READINGS)
        if not 1 <= counts <= CEILING:
            most = float(calibration.pressure.value(CEILING * READINGS))
            given, highest = (pressure_text(x, self.unit) for x in (limit, most))
            raise RigError(
                f"the limit of {given} is {counts} counts of the transducer; it must be 1 to {CEILING} "
                f"counts (at most {highest}): choose another limit or another transducer"
            )
        return counts

    def _jump_counts(self, calibration: Calibration) -> int:
        """Return the jump limit in counts of one reading, rounded."""
        limit, count = self.jump_limit, calibration.pressure.gain * READINGS
        counts = round(limit / count) if math.isfinite(limit) else 0
        if not LEAST_JUMP <= counts <= 1023:
            values = (limit, LEAST_JUMP * count, 1023 * count)
            given, least, most = (pressure_text(x, self.unit) for x in values)
            raise RigError(
                f"a jump limit of {given} is {counts} counts of the transducer; it must be "
                f"{LEAST_JUMP} to 1023 counts ({least} to {most})"
            )
        return counts


def stored_settings(commands: list[tuple[str, tuple[float, ...]]]) -> dict[str, Any]:
    """Return the settings that a device reports after these commands, from the firmware's Python port."""
    twin = DeviceControl(0, 0, least_div=1, trip_ceiling=1023, latch=Latch())
    for verb, values in commands:
        words = command_body(0, verb, *values).encode().split()[2:]
        twin.execute(verb.encode(), read_numbers(verb.encode(), words) or [])
    twin.step(0, 0)
    return lasting(twin.settings)


def lasting(settings: DeviceSettings) -> dict[str, Any]:
    """Return the settings that are constant during a test, by name."""
    passing = {"law", "boot", "since", "set_point", "feed_forward"}
    named = settings.law._asdict() | settings._asdict()
    return {name: value for name, value in named.items() if name not in passing}


def _device_calibration(calibration: Calibration) -> tuple[float, float]:
    """Return zero [counts of one reading] and span [psi per 1024 counts] for the device.

    The converter rounds down, so the zero of a 0 to 5 V transducer is half a count below 0. Zeros less than
    one count below 0 are set to 0.
    """
    sensor = calibration.pressure
    zero, span = sensor.zero / READINGS, sensor.gain * READINGS * 1024 / PSI
    zero = 0.0 if -1 < zero < 0 else zero
    if not (0 <= zero < 1023.9 and 1 / 64 <= span < 1023.9):
        raise RigError(
            f"the transducer's zero must be 0 to 1023.9 counts and its span 0.02 to 1023.9 psi; the "
            f"calibration has {zero:.2f} counts and {span:.2f} psi: check the transducer"
        )
    return zero, span


class Rig:
    """Control and record a device with a pressure limit; leaving the `with` block always vents it.

    Args:
        link: link to the device.
        calibration: calibration of its sensors and its valve or pump.
        journal: journal that records everything, or None.
        settings: fields of `RigSettings`, such as `pressure_limit` (required) and `control`.

    Attributes:
        settings: control and trip settings.
        lost: number of records lost on the line.
        unseen: transducer faults that the device cannot detect, as sentences; set on entry to the block.
        set_point: last set pressure [Pa], initially nan.

    Raises:
        RigError: the pressure limit is missing, or a limit is outside the transducer's range.
    """

    def __init__(
        self,
        link: AbstractLink,
        calibration: Calibration,
        *,
        journal: Journal | None = None,
        **settings: Any,
    ) -> None:
        self.link, self.calibration = link, calibration
        self.settings = RigSettings(**settings)
        self.settings.commands(calibration)  # raises before the port is used
        self._watch = FlowWatch()
        self._wanted: dict[str, Any] = {}
        self._boot: int | None = None
        self.lost, self.set_point = 0, math.nan
        self.unseen: tuple[str, ...] = ()
        self._journal = journal
        self._active_from: int | None = None

    def __enter__(self) -> Self:
        self.link.attach(self._journal)
        try:
            self._set_up(greet(self.link))
            self.note("channels", **check_channels(self.link))
        except BaseException as error:
            self._leave(error)
            raise
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        self._leave(error)

    def note(self, kind: str, /, **fields: object) -> None:
        """Write a note to the journal, if there is one."""
        if self._journal is not None:
            self._journal.note(kind, **fields)

    def set_pressure(self, pressure: float) -> None:
        """Set the pressure to hold.

        Args:
            pressure: set pressure [Pa gauge], >= 0 and below the limit.

        Raises:
            RigError: the pressure is outside this range or the range of the feed-forward.
        """
        limit = self.settings.pressure_limit
        if not 0 <= pressure < limit:
            highest, got = (pressure_text(x, self.settings.unit) for x in (limit, pressure))
            raise RigError(
                f"the set pressure must be >= 0 and below the limit of {highest}, got {got}"
            )
        output = self.calibration.feed_forward.output(pressure, self.settings.unit)
        answer = self.link.command("set", pressure / PSI, output)
        self.note("set", pressure_Pa=pressure, feed_forward_counts=output, seq=answer.seq)
        self.set_point, self._watch = pressure, FlowWatch()
        newest = self.link.newest
        if self._active_from is None or newest is None or newest.state != RUN:
            self._activate("run")
        self.link.keep_alive()

    @property
    def pressure(self) -> float:
        """Pressure in the newest record [Pa gauge]; nan if there is no record."""
        newest = self.link.newest
        return float(self.calibration.pressure.value(newest.pressure_sum if newest else math.nan))

    @property
    def force(self) -> float:
        """Force in the newest record [N]; nan if there is no record."""
        newest = self.link.newest
        return float(self.calibration.force.value(newest.force_sum if newest else math.nan))

    def manual(self, output: int) -> None:
        """Hold an output [counts, 0..255] with the controller off, for calibration."""
        self._activate("man", output)
        self.note("manual", output=output)

    def stop(self) -> None:
        """Switch the output off and open the dump valve."""
        self._active_from = None
        self.link.command("stop")

    def wait(self, seconds: float) -> None:
        """Wait for a time [s] while supervising the rig.

        Raises:
            RigFault: the device tripped, was reset or is silent, or the recorder failed.
        """
        end = self.link.now + seconds
        self.link.keep_alive()
        while (left := end - self.link.now) > 1e-9:
            self.link.sleep(min(LOOK, left))
            self.link.keep_alive()
            self.check()

    def check(self) -> None:
        """Check the device, the link and the recorder once; see `wait`."""
        self.link.check()
        while self.link.alarms:
            match self.link.alarms.popleft():
                case Lost(_, _, records):
                    self.lost += records
                case Reset(old, new, cause):
                    what = f"was reset (boot {old} to {new}, cause {cause}) and is venting"
                    self.fault(f"the device {what}; check its power supply")
                case Silent(seconds):
                    what = f"has been silent for {seconds:.1f} s and will vent by itself"
                    self.fault(f"the device {what}; check the cable")
        if wrong := self._wrong_settings():
            self.fault(f"the settings of the device changed: {', '.join(wrong)}; it will now vent")
        newest, since = self.link.newest, self._active_from
        if newest is None:
            return
        if since is not None and newest.seq >= since and newest.state not in DRIVEN:
            self._left_by_itself(newest)
        held = abs(self.pressure - self.set_point) <= 2 * HELD
        if newest.state == RUN and self._watch.contradicts(newest, held=held):
            self.fault(
                "the load rises during inflow while the pressure reading is constant: the "
                "channels are swapped, or the transducer's line is blocked; the device will now vent"
            )

    def sync(self, seconds: float) -> None:
        """Raise the sync pin for a time [s], rounded to whole records, and note the first record.

        Raises:
            RigError: the time is shorter than one record or longer than 1000 records.
        """
        records = round(seconds * TICK_HZ / TICKS_PER_RECORD)
        answer = self.link.command("sync", records)
        self.note("sync", seq=answer.seq, records=records)

    def _set_up(self, hello: Hello) -> None:
        """Send all settings to the device, verify them, and note them in the journal."""
        link, session, calibration = self.link, self.link.session, self.calibration
        link.command("stop")
        status = device_status(link)
        if status.state == TRIP:
            raise RigError(
                f"the device is tripped: {trip_text(status, calibration)}. Find the cause, then "
                "acknowledge the trip with `famjax rig acknowledge PORT`"
            )
        if hello.board != calibration.board:
            raise RigError(
                f"this is board {hello.board}, but the calibration is for board {calibration.board} (0: no "
                f"number): calibrate again, or, if the calibration is valid for this board, write "
                f"board = {hello.board} as the first line of the calibration file"
            )
        commands = self.settings.commands(calibration)
        for verb, values in commands:
            link.command(verb, *values)
        until = link.now + 1.0
        while (stored := session.settings) is None or not session.settings_known:
            if link.now > until:
                raise RigFault("the device does not report its settings: check the cable")
            link.sleep(LOOK)
        self._wanted, self._boot = stored_settings(commands), stored.boot
        if wrong := self._wrong_settings():
            raise RigFault(
                f"the device did not accept its settings: {', '.join(wrong)}; upload the firmware again"
            )
        self.unseen = tuple(unseen(calibration, alive=watch_rest(link, calibration)))
        self.note(
            "rig", **self.settings.as_note(calibration), unseen=self.unseen,
            trip_counts=stored.trip, jump_counts=stored.jump, hello=hello._asdict(),
        )  # fmt: skip

    def _wrong_settings(self) -> list[str]:
        """Return the settings in which the device differs from the plan, as "silence 5000 not 500"."""
        session, wanted = self.link.session, self._wanted
        stored = session.settings
        if stored is None or not session.settings_known or stored.boot != self._boot:
            return []  # not known; a reset is reported as such
        found = lasting(stored)
        return [f"{k} {found[k]} not {v}" for k, v in wanted.items() if found[k] != v]

    def _left_by_itself(self, record: Sample) -> NoReturn:
        """Report why the device stopped; for a trip, with the reading and the output at that moment."""
        self._active_from = None
        self.link.sleep(LOOK)  # the status arrives after the record
        fault, status = FAULTS[record.fault], self.link.session.status
        said, trip = f"{fault}; {ADVICE[fault]}", {}
        if record.state == TRIP and status is not None and status.state == TRIP:
            said = trip_text(status, self.calibration)
            trip = {"cause": fault, "tick": status.tripped_at, "counts": status.tripped_count,
                    "output": status.tripped_output}  # fmt: skip
        state = STATES[record.state]
        self.fault(f"the device went to {state} by itself: {said}; it is venting", **trip)

    def fault(self, what: str, **trip: object) -> NoReturn:
        """Stop the heartbeats so that the device vents, note the fault, and raise it as `RigFault`."""
        self._active_from = None
        self.link.rest()
        self.note("fault", what=what, **trip)
        raise RigFault(what)

    def _activate(self, verb: str, *values: float) -> None:
        self.link.keep_alive()
        self._active_from = None
        try:
            self._active_from = self.link.command(verb, *values).seq
        except RigError:
            if (status := device_status(self.link)).state == TRIP:
                self.fault(f"the device tripped and vented: {trip_text(status, self.calibration)}")
            raise

    def _not_vented(self) -> str | None:
        """Wait while the pressure falls with the dump valve open; return a warning if some remains."""
        before, record = math.inf, None
        while REST_PRESSURE < self.pressure < 0.9 * before and self.link.newest is not record:
            before, record = self.pressure, self.link.newest
            self.link.sleep(1.0)
        if not self.pressure > REST_PRESSURE or self.link.newest is record:
            return None
        reading = pressure_text(self.pressure, self.settings.unit)
        return (
            f"the dump valve is open, but the transducer still reads {reading}: close the supply, and vent "
            "the rig by hand before you touch it"
        )

    def _leave(self, error: BaseException | None) -> None:
        """Vent, note how the test ended, and detach the journal."""
        self.link.rest()
        failure: RigFault | None = RigFault("interrupted before the device had stopped")
        try:
            self.stop()
            failure = None
        except (RigError, RigFault) as stop_error:
            failure = RigFault(
                f"the device did not confirm the stop ({stop_error}). Without heartbeats, it "
                "vents within a second: check the pressure before you touch the rig"
            )
        finally:
            self.link.settle(SETTLE if failure is None else 0.0)
            if failure is None and (left := self._not_vented()) is not None:
                failure = RigFault(left)
            reason = "complete" if error is None else f"{type(error).__name__}: {error}"
            self.note("end", reason=reason, confirmed=failure is None)
            self.link.attach(None)
        if failure is not None and error is None:
            raise failure
        if failure is not None and error is not None:
            error.add_note(str(failure))


def acknowledge(link: AbstractLink, calibration: Calibration | None = None) -> None:
    """Clear a trip after a person has found its cause; never call this automatically.

    Args:
        link: link to the device.
        calibration: calibration of its transducer, used to restore the floor, which is lost in a reset.

    Raises:
        RigError: the device refuses, because the pressure is at the limit, the reading is out of range, or
            the device is running.
        RigFault: the device does not respond.
    """
    if calibration is not None:
        link.command("floor", floor_counts(calibration))
    link.command("clear")


def trip_text(status: DeviceStatus, calibration: Calibration | None = None) -> str:
    """Return a description of a trip: fault, reading, output, and what to check.

    >>> trip_text(DeviceStatus(1, 9, 45, 3, 6, 0, 0, 0, 0, 0, 0, 40, 12, 131, 0))
    'range at 12 counts, output 131; check for a broken wire, a short circuit, and an unplugged or \
unpowered transducer'
    """
    fault = FAULTS[status.fault]
    reading = f"{status.tripped_count} counts"
    if calibration is not None:
        pressure = float(calibration.pressure.value(READINGS * status.tripped_count))
        reading += f" ({pressure / PSI:.4g} psi)"
    return f"{fault} at {reading}, output {status.tripped_output}; {ADVICE[fault]}"
