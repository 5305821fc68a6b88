"""A rig on a terminal: values and a plot of the pressure, as plain text."""

from collections import deque

import numpy as np

from rig.calibration import READINGS, Calibration, Sensor
from rig.protocol import FAULTS, STATES, Sample

from ...boundary.units import factor, unit_system

_BLOCKS = " ▁▂▃▄▅▆▇█"


class Monitor:
    """The last records of a rig as a few lines of text.

    Args:
        calibration: of the sensors; None shows counts.
        system: "si", "metric" or "us".
        width: columns of the plot.
        height: rows of the plot.
        every: records that one column of the plot stands for.
        ticks_per_record: as the device has it.

    >>> monitor = Monitor(width=8, height=2)
    >>> monitor.add(Sample(1, 7, 40, 1000, 200, 500, 131, 0, 1))
    >>> print(monitor.line())
    record 7  pressure 200 counts  force 100 counts  output 131  RUN
    """

    def __init__(
        self,
        calibration: Calibration | None = None,
        system: str = "us",
        *,
        width: int = 60,
        height: int = 8,
        every: int = 20,
        ticks_per_record: int = READINGS,
    ) -> None:
        self.ticks_per_record = ticks_per_record
        counts = Sensor(1 / READINGS, 0.0)
        self._sensors, self._units, self._scales = (
            (counts, counts),
            ("counts", "counts"),
            (1.0, 1.0),
        )
        if calibration:
            pressure, force = unit_system(system)["pressure"], unit_system(system)["force"]
            self._sensors = calibration.pressure, calibration.force
            self._units = pressure, force
            self._scales = factor(pressure, "pressure"), factor(force, "force")
        self._height, self._every = height, every
        self._columns: deque[float] = deque(maxlen=width)
        self._sum, self._count = 0.0, 0
        self._last: Sample | None = None

    def add(self, sample: Sample) -> None:
        """Take one record."""
        self._last = sample
        self._sum += self._values(sample)[0]
        self._count += 1
        if self._count == self._every:
            self._columns.append(self._sum / self._count)
            self._sum, self._count = 0.0, 0

    def line(self, set_point: float | None = None) -> str:
        """The newest values, units beside them, with the set pressure [Pa] where one is given."""
        sample = self._last
        if sample is None:
            return "no record yet"
        pressure, force = self._values(sample)
        fault = f"  fault: {FAULTS[sample.fault]}" if sample.fault else ""
        wanted = "" if set_point is None else f" of {set_point / self._scales[0]:.5g}"
        return (
            f"record {sample.seq}  pressure {pressure:.5g}{wanted} {self._units[0]}  "
            f"force {force:.5g} {self._units[1]}  output {sample.output}  "
            f"{STATES[sample.state]}{fault}"
        )

    def plot(self) -> str:
        """The pressure of the last while, the newest on the right, its range at the left."""
        if not self._columns:
            return ""
        low, high = min(self._columns), max(self._columns)
        span = (high - low) or 1.0
        levels = [(value - low) / span * self._height for value in self._columns]
        rows = []
        for row in range(self._height - 1, -1, -1):
            cells = (round(min(max(level - row, 0.0), 1.0) * 8) for level in levels)
            edge = high if row == self._height - 1 else low if row == 0 else None
            label = f"{edge:10.5g}" if edge is not None else " " * 10
            rows.append(f"{label} │{''.join(_BLOCKS[cell] for cell in cells)}")
        return "\n".join(rows)

    def _values(self, sample: Sample) -> tuple[float, float]:
        sums = np.array([sample.pressure_sum, sample.force_sum]) * READINGS / self.ticks_per_record
        values = zip(self._sensors, sums, self._scales, strict=True)
        pressure, force = (float(sensor.value(total)) / scale for sensor, total, scale in values)
        return pressure, force
