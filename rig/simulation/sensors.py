"""A sensor behind a 10-bit converter: range, noise and quantisation."""

import dataclasses
import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from famjax.boundary.toml_file import NotNegative, check_fields

from ..calibration.sensor import READINGS, Sensor
from ..errors import RigError
from .circuits import PSI
from .muscle import POUND

FULL_COUNTS = 1023
_STEPS = 1024  # of the converter over its reference
_REFERENCE_VOLTS = 5.0
_BLOCK = 4096  # noise is drawn in blocks: a draw for one reading costs as much as a whole step


@dataclasses.dataclass(frozen=True)
class SimulatedSensor:
    """A linear sensor read by a 10-bit converter with a reference of 5 V.

    counts = floor((low_volts + (high_volts - low_volts)(x - low)/(high - low) + noise) 1024 / 5)

    held within 0..1023, as the data sheet of the ATmega328P has it.

    Attributes:
        low: reading [SI] at `low_volts`.
        high: reading [SI] at `high_volts`.
        noise: standard deviation [SI], normal.
        correlation_time: [s] of the noise; 0 for white noise. Noise that is correlated survives
            the mean of several readings, as pick-up and pump ripple do.
        low_volts: output [V] at `low`; above 0, so that a broken wire differs from a low reading.
        high_volts: output [V] at `high`.
    """

    low: float
    high: float
    noise: NotNegative
    correlation_time: NotNegative = 0.0
    low_volts: float = 0.5
    high_volts: float = 4.5

    def __post_init__(self) -> None:
        check_fields(self, RigError)
        if not self.high > self.low:
            raise RigError(f"high must exceed low, got {self.low} and {self.high}")
        if not 0 <= self.low_volts < self.high_volts <= _REFERENCE_VOLTS:
            raise RigError(
                f"0 <= low_volts < high_volts <= 5 must hold, got {self.low_volts} and "
                f"{self.high_volts} V"
            )

    @cached_property
    def counts_per_unit(self) -> float:
        """Counts per SI unit of the reading."""
        span = (self.high_volts - self.low_volts) / (self.high - self.low)
        return span * _STEPS / _REFERENCE_VOLTS

    @cached_property
    def zero_counts(self) -> float:
        """Counts, not rounded down, at a reading of zero."""
        return self.low_volts * _STEPS / _REFERENCE_VOLTS - self.low * self.counts_per_unit

    def counts(self, reading: float, error: float = 0.0) -> int:
        """Counts [0..1023] of a reading [SI] with an error [counts]; the range ends are the ADC's."""
        counts = int(self.zero_counts + self.counts_per_unit * reading + error)
        return 0 if counts < 0 else counts if counts < FULL_COUNTS else FULL_COUNTS

    def calibration(self) -> Sensor:
        """The result of a perfect calibration of this sensor, for sums of five readings.

        A converter rounds down, so that its counts are half a count low in the mean.
        """
        return Sensor(1 / (READINGS * self.counts_per_unit), READINGS * (self.zero_counts - 0.5))

    def errors(self, interval: float, seed: int | np.random.Generator) -> Iterator[float]:
        """Endless noise [counts], one value every `interval` [s].

        The seed alone decides the values. Correlated noise is a first-order Gauss-Markov process.
        """
        rng = np.random.default_rng(seed)
        scale = self.noise * self.counts_per_unit
        keep = math.exp(-interval / self.correlation_time) if self.correlation_time else 0.0
        fresh = math.sqrt(1.0 - keep * keep) * scale
        last = float(rng.normal()) * scale
        while True:
            for draw in rng.normal(size=_BLOCK).tolist():
                last = keep * last + fresh * draw
                yield last


def pressure_transducer(
    high: float = 200 * PSI, noise: float = 0.25 * PSI, correlation_time: float = 0.01
) -> SimulatedSensor:
    """The reference work's transducer, 0 to 200 psi; its noise and their correlation are ASSUMED.

    Both are part of what is measured: with the air circuit's own motion below 0.12 psi, the printed
    standard deviations of 0.27 to 0.34 psi are mostly the transducer's.

    >>> round(1 / (pressure_transducer().counts_per_unit * PSI), 3)  # psi per count
    0.244
    """
    return SimulatedSensor(0.0, high, noise, correlation_time)


def load_cell(high: float = 1500 * POUND, noise: float = 0.5 * POUND) -> SimulatedSensor:
    """A load cell of -5 % to 100 % of its range; range and noise are ASSUMED.

    The reference work's reads up to 1000 lbf, which the 7/8 in muscle exceeds at 100 psi.
    """
    return SimulatedSensor(-0.05 * high, high, noise)
