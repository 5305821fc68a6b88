"""The simulated test machine: triangle strokes, its own load cell, log and clock."""

import dataclasses
import math
from pathlib import Path

import numpy as np

from ..errors import RigError
from .muscle import INCH, POUND


@dataclasses.dataclass(frozen=True)
class MachineClock:
    """A clock with offset and drift: reading = offset + (1 + rate) t, with t the true time.

    Attributes:
        offset: reading [s] at the true time 0.
        rate: by which it gains, s per s.
    """

    offset: float = 0.0
    rate: float = 0.0

    def reading(self, true_time: float) -> float:
        """The reading [s] at a true time [s]."""
        return self.offset + (1 + self.rate) * true_time

    def true_time(self, reading: float) -> float:
        """The true time [s] at which it shows a reading [s]."""
        return (reading - self.offset) / (1 + self.rate)


class TestMachine:
    """A screw-driven machine that shortens a muscle at constant rate and lets it out again.

    A stroke begins at the rest length, turns where the load falls to `turn_load` (or after the
    given stroke), and ends at the rest length. Neglected: the frame's compliance and the time that
    the drive takes to reverse.

    Args:
        rest_length: L0 [m], where strokes begin and end.
        shortest: length [m] at which the machine's limit switch stops it.
        clock: of its log.
        log_interval: [s] of its own clock (Chambers 2021, chapter 4: 0.02 s).
        load_noise: standard deviation of the load in its log [N]; ASSUMED.
        seed: of the noise.

    Attributes:
        length: active length L [m].
        velocity: dL/dt [m/s], negative while the muscle shortens.
        sync: whether its digital input is high.
        cycles_left: strokes that remain, the present one included.
        stopped_by_limit: True after the limit switch has ended a test.
    """

    __test__ = False  # not a test of pytest's

    def __init__(
        self,
        rest_length: float,
        *,
        shortest: float,
        clock: MachineClock | None = None,
        log_interval: float = 0.02,
        load_noise: float = 0.3 * POUND,
        seed: int = 0,
    ) -> None:
        if not 0 < shortest < rest_length:
            raise RigError(f"0 < shortest < rest_length must hold, got {shortest}, {rest_length} m")
        self.rest_length, self.shortest = rest_length, shortest
        self.clock = clock or MachineClock()
        self.log_interval, self.load_noise = log_interval, load_noise
        self.length = rest_length
        self.velocity = 0.0
        self.sync = False
        self.cycles_left = 0
        self.stopped_by_limit = False
        self._program = (0.0, shortest, 0.0)
        self._rng = np.random.default_rng(seed)
        self._rows: list[tuple[float, float, float, float]] = []
        self._next_row = math.ceil(self.clock.offset / log_interval) * log_interval
        self._next_at = self.clock.true_time(self._next_row)
        self._last_load = 0.0

    @property
    def busy(self) -> bool:
        """Whether strokes are under way."""
        return self.cycles_left > 0

    def start(
        self,
        cycles: int,
        rate: float = 0.04 * INCH,
        *,
        stroke: float | None = None,
        turn_load: float = 0.0,
    ) -> None:
        """Begin strokes from the rest length, or add more of the same to those under way.

        Args:
            cycles: number of strokes there and back.
            rate: of the crosshead [m/s] (chapter 4: 0.04 in/s).
            stroke: [m] after which it turns at the latest; the limit switch where None.
            turn_load: [N] to which the load falls before it turns.

        Raises:
            RigError: other strokes are under way, or the numbers make no stroke.
        """
        if cycles < 1 or not rate > 0:
            raise RigError(f"a test needs cycles >= 1 and rate > 0 m/s, got {cycles} and {rate}")
        longest = self.rest_length - self.shortest
        if stroke is not None and not 0 < stroke <= longest:
            raise RigError(f"stroke must lie in (0, {longest:.5g}] m, got {stroke} m")
        turn_at = self.shortest if stroke is None else self.rest_length - stroke
        program = (rate, turn_at, turn_load)
        if self.busy:
            if program != self._program:
                raise RigError(
                    "the machine is busy with other strokes: wait for them, or stop() it"
                )
            self.cycles_left += cycles
            return
        self._program = program
        self.cycles_left, self.velocity = cycles, -rate
        self.stopped_by_limit = False

    def stop(self) -> None:
        """End all motion where the crosshead is."""
        self.cycles_left, self.velocity = 0, 0.0

    def step(self, now: float, dt: float, load: float) -> None:
        """Move by dt [s] up to the true time `now` [s], under the load [N] at its beginning."""
        velocity = self.velocity
        length = self.length + velocity * dt
        if velocity < 0:
            rate, turn_at, turn_load = self._program
            if load <= turn_load or length <= turn_at:
                if length <= self.shortest and load > turn_load:
                    self.stopped_by_limit = True
                length = max(length, turn_at)
                self.velocity = rate
        elif velocity > 0 and length >= self.rest_length:
            length = self.rest_length
            self.cycles_left -= 1
            self.velocity = -self._program[0] if self.cycles_left else 0.0
        if now >= self._next_at:
            self._log(now, dt, length, load)
        self.length, self._last_load = length, load

    def _log(self, now: float, dt: float, length: float, load: float) -> None:
        """One row at its nominal time, between the last step and this one."""
        share = min(max(1 - (now - self._next_at) / dt, 0.0), 1.0)
        # The load belongs to the beginning of the step: at `share` of it, it is `share` on from there.
        force = load + share * (load - self._last_load) + self._rng.normal() * self.load_noise
        x = self.length + share * (length - self.length)
        self._rows.append((self._next_row, x - self.rest_length, force, float(self.sync)))
        self._next_row += self.log_interval
        self._next_at = self.clock.true_time(self._next_row)

    def log(self) -> dict[str, np.ndarray]:
        """The recorded columns, each of shape (n,): time of its own clock, displacement, force, sync.

        The displacement is negative where the muscle is shorter than at rest.
        """
        table = np.array(self._rows).reshape(-1, 4)
        names = ("time_s", "displacement_m", "force_N", "sync")
        return {name: table[:, k] for k, name in enumerate(names)}

    def write_log(self, path: str | Path) -> Path:
        """Write the log as a delimited file with units, as such machines do."""
        lines = ["Time,Extension,Load,Digital input", "(s),(mm),(N),(-)"]
        for time, displacement, force, sync in self._rows:
            lines.append(f"{time:.4f},{displacement * 1e3:.5f},{force:.4f},{sync:.0f}")
        path = Path(path)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path
