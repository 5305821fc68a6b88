"""The device's configuration for a test: gains, limits in counts, transducer."""

import dataclasses
import math
from typing import Self

from famjax.boundary.units import UNITS

from ..calibration.sensor import READINGS
from ..calibration.whole_rig import Calibration
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
