"""What the device takes for a reading that can be believed: limits in counts and times."""

import dataclasses
import math
from typing import Annotated

from msgspec import Meta

from famjax.boundary.toml_file import check_fields

from ..calibration.sensor import READINGS
from ..calibration.whole_rig import Calibration
from ..errors import RigError

LIVE_ZERO = 20
"""Least counts at 0 Pa of a transducer that has a floor: 0.1 V."""
FLOOR_SHARE = 0.6
"""Floor over the counts at 0 Pa: 0.3 V of 0.5 V."""

_Reading = Annotated[int, Meta(ge=0, le=1023, description="0 to 1023 counts")]


@dataclasses.dataclass(frozen=True)
class Guards:
    """When the device trips because its reading cannot be true; `firmware/README.md` says why.

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
