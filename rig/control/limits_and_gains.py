"""What a device is given before a test: trip and jump limit in counts, guards, gains, transducer."""

import dataclasses
import math
from typing import Annotated, Any, Self

from msgspec import Meta

from famjax.boundary.toml_file import check_fields
from famjax.boundary.units import UNITS

from ..calibration.sensor import READINGS
from ..calibration.whole_rig import Calibration, calibration_as_dict
from ..errors import RigError

_PSI = UNITS["pressure"]["psi"]

JUMP_LIMIT = 15 * _PSI
"""Change of the pressure within five ticks (10 ms) that trips [Pa]; see `jump_counts`."""
LEAST_JUMP = 5
"""Counts, above noise of a count or two."""


@dataclasses.dataclass(frozen=True)
class Control:
    """Gains of the pressure controller, u = v + Kp e + Ki int e dt, in counts of pulse-width modulation.

    Attributes:
        proportional: Kp [counts/Pa], >= 0. The device stores it in 1/256 count per psi.
        integral: Ki [counts/(Pa s)], >= 0, likewise.
        integral_limits: least and greatest integral term [counts], within -255..0 and 0..255.
            Symmetric limits hold the published pressures, limits of 0..255 do not.
    """

    proportional: float
    integral: float
    integral_limits: tuple[int, int] = (-128, 128)

    @classmethod
    def per_psi(cls, proportional: float, integral: float) -> Self:
        """Gains in counts per psi and per psi and second, as the reference work prints them."""
        return cls(proportional / _PSI, integral / _PSI)


def trip_counts(calibration: Calibration, limit: float | None) -> int:
    """The pressure limit in counts of one reading, rounded down."""
    if limit is None or not math.isfinite(limit) or limit <= 0:
        raise RigError(
            f"a rig runs only under a pressure limit > 0, got {limit}; give the muscle's or the "
            "circuit's, whichever is lower"
        )
    counts = int(calibration.pressure.counts(limit) // READINGS)
    if not 1 <= counts <= 1023 - 3:
        raise RigError(
            f"the limit of {limit:.0f} Pa is {counts} counts of the transducer, which ends at 1023: "
            "it could not be seen; choose a lower limit or another transducer"
        )
    return counts


def check_feed_forward(circuit: str, calibration: Calibration) -> None:
    """Refuse a water circuit with one output for every pressure, which is an air valve's bias.

    A pump at half speed holds some pressure of its own, whatever is set: 39 psi in the simulated
    circuit, for which the integral has to make up while the pressure has risen already.

    Raises:
        RigError: the circuit is "water" and the feed-forward does not depend on the pressure.
    """
    if circuit == "water" and not any(calibration.feed_forward.coefficients[1:]):
        output = calibration.feed_forward.coefficients[0]
        raise RigError(
            f"a water circuit needs a feed-forward that rises with the pressure, got {output:g} counts "
            "at every pressure, the bias of an air valve: the pump would raise a pressure that is not "
            "set. Step the pump against the needle valve (calibrate_feed_forward) and write the result "
            "into the calibration"
        )


def jump_counts(calibration: Calibration, limit: float) -> int:
    """The change within five ticks that trips, in counts of one reading, rounded.

    A transducer that breaks or is unplugged jumps. So does the pressure of a small muscle that a
    large valve fills: then the limit must be higher, and protects less.
    """
    counts = round(limit / (calibration.pressure.gain * READINGS)) if math.isfinite(limit) else 0
    if not LEAST_JUMP <= counts <= 1023:
        count = calibration.pressure.gain * READINGS / _PSI
        raise RigError(
            f"a jump limit of {limit:.0f} Pa is {counts} counts of the transducer; the device takes "
            f"{LEAST_JUMP} to 1023, here {LEAST_JUMP * count:.3g} to {1023 * count:.4g} psi"
        )
    return counts


def device_calibration(calibration: Calibration) -> tuple[float, float]:
    """Zero [counts of one reading] and span [psi per 1024 counts], as the device takes them.

    A transducer of 0 to 5 V has its zero half a count below the converter's end, which rounds down:
    less than a count below counts as 0.
    """
    sensor = calibration.pressure
    zero, span = sensor.zero / READINGS, sensor.gain * READINGS * 1024 / _PSI
    zero = 0.0 if -1 < zero < 0 else zero
    if not (0 <= zero < 1023.9 and 1 / 64 <= span < 1023.9):
        raise RigError(
            f"the device takes a zero of 0 to 1023.9 counts and a span of 0.02 to 1023.9 psi, the "
            f"calibration gives {zero:.2f} counts and {span:.2f} psi; check the transducer"
        )
    return zero, span


LIVE_ZERO = 20
"""Least counts at 0 Pa of a transducer that has a floor: 0.1 V."""
FLOOR_SHARE = 0.6
"""Floor over the counts at 0 Pa: 0.3 V of 0.5 V."""

_Reading = Annotated[int, Meta(ge=0, le=1023, description="0 to 1023 counts")]


@dataclasses.dataclass(frozen=True)
class Guards:
    """When the device trips because its reading is implausible; the reasons are in `firmware/README.md`.

    Attributes:
        floor: least plausible reading [counts of one conversion]; None derives it from the
            calibration, see `floor_counts`.
        ceiling: greatest plausible reading [counts]: 4.7 V, where no transducer of 0.5 to 4.5 V is.
        still: time [s] within two counts that trips, of a reading that varied at rest;
            one that varied little has up to three times as long.
        frozen_output: PWM counts by which the output may exceed the one that held the pressure;
            255 switches this off.
        frozen: time [s] at twice that output without a move of the reading that trips.
        stall: time [s] with output or integral at its upper limit without a rise that trips.
    """

    floor: _Reading | None = None
    ceiling: _Reading = 963
    still: Annotated[float, Meta(ge=0.5, le=60, description="0.5 to 60 s")] = 0.7
    frozen_output: Annotated[int, Meta(ge=1, le=255, description="1 to 255 counts")] = 4
    frozen: Annotated[float, Meta(ge=0.1, le=2, description="0.1 to 2 s")] = 0.75
    stall: Annotated[float, Meta(ge=0.5, le=30, description="0.5 to 30 s")] = 3.0

    def __post_init__(self) -> None:
        check_fields(self, RigError)

    def commands(self, calibration: Calibration, trip: int) -> list[tuple[str, tuple[float, ...]]]:
        """The commands that set them.

        Args:
            calibration: of the transducer, for the floor.
            trip: the pressure limit [counts].

        Raises:
            RigError: a transducer at 0 Pa reads outside floor and ceiling, or the limit does.
        """
        floor = floor_counts(calibration) if self.floor is None else self.floor
        zero = calibration.pressure.zero / READINGS
        if self.floor is not None and not self.floor < zero:
            raise RigError(
                f"the floor must lie below the {zero:.0f} counts that the transducer reads at 0 Pa, "
                f"got {self.floor}; leave it out and it is derived"
            )
        if not trip <= self.ceiling:
            raise RigError(
                f"the pressure limit of {trip} counts must not exceed the ceiling of plausible "
                f"readings, {self.ceiling} counts; lower the one or raise the other"
            )
        return [
            ("floor", (floor,)),
            ("ceiling", (self.ceiling,)),
            ("still", (round(1000 * self.still),)),
            ("frozen", (self.frozen_output, round(1000 * self.frozen))),
            ("stall", (round(1000 * self.stall),)),
        ]


def floor_counts(calibration: Calibration) -> int:
    """Least plausible reading of one conversion [counts]; 0 where the transducer can have none.

    A gauge pressure is never far below zero, so a transducer whose 0 Pa lies above the converter's
    end reads less only when it fails: six tenths of its reading at 0 Pa. One of 0 to 5 V reads 0 at
    0 Pa and with a broken wire alike.

    >>> from rig.simulation import load_cell, pressure_transducer
    >>> floor_counts(Calibration(pressure_transducer().calibration(), load_cell().calibration()))
    61
    """
    zero = calibration.pressure.zero / READINGS
    return math.floor(FLOOR_SHARE * zero) if zero >= LIVE_ZERO else 0


@dataclasses.dataclass(frozen=True)
class RigSettings:
    """What a device controls and trips with.

    Attributes:
        pressure_limit: at which it trips [Pa gauge]; there is no default.
        control: gains.
        jump_limit: change of the pressure within 10 ms at which it trips [Pa].
        guards: when it rejects its reading as implausible.
    """

    pressure_limit: float
    control: Control
    jump_limit: float = JUMP_LIMIT
    guards: Guards = dataclasses.field(default_factory=Guards)

    def commands(self, calibration: Calibration) -> list[tuple[str, tuple[float, ...]]]:
        """The commands that set them, and the transducer.

        Raises:
            RigError: it cannot take the transducer, or a limit is missing or cannot be seen by it.
        """
        trip, gains = trip_counts(calibration, self.pressure_limit), self.control
        return [
            ("cal", device_calibration(calibration)),
            ("trip", (trip,)),
            ("jump", (jump_counts(calibration, self.jump_limit),)),
            *self.guards.commands(calibration, trip),
            ("gain", (gains.proportional * _PSI, gains.integral * _PSI)),
            ("ilim", gains.integral_limits),
        ]

    def as_note(self, calibration: Calibration) -> dict[str, Any]:
        """What a journal holds of them, units in the keys."""
        return {
            "pressure_limit_Pa": self.pressure_limit,
            "jump_limit_Pa": self.jump_limit,
            "guards": dataclasses.asdict(self.guards),
            "control": dataclasses.asdict(self.control),
            "calibration": calibration_as_dict(calibration),
        }
