"""The plant of a simulated rig: muscle, test machine and pressure circuit, without sensors or controller.

A circuit is a lumped volume of one pressure. What is in operation has `pressure`, the gauge pressure P
[Pa] in the muscle, and `step(output, dump_open, volume, rate, give, dt)`, which advances by dt [s], a
tick of the device or less, by a rule of second order: `output` 0 to 255, V [m3] that the fluid fills at
the beginning, its change [m3/s] by motion at constant pressure, and dV/dP [m3/Pa] at constant length.
Parameters that the reference work does not print are ASSUMED and say so.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from famjax.boundary.toml_file import NotNegative, Positive, check_fields
from famjax.units import INCH, LBF, PSI

from .calibration import FULL_OUTPUT
from .errors import RigError

ATMOSPHERE = 101325.0  # ambient pressure [Pa], absolute
ANR_PRESSURE = 1e5  # of the reference atmosphere in which ISO 6358 states volume flow [Pa]
# Pressure ratio above which the flow is taken as linear: its slope is infinite at 1.
SLOW_FLOW = 0.95


def iso_6358_flow(
    upstream: float, downstream: float, conductance: float, critical_ratio: float
) -> tuple[float, float, float]:
    """Volume flow at reference conditions through an orifice, and its two slopes, by ISO 6358.

    Q = C p_1 psi(r), r = p_2 / p_1, with psi = 1 up to the critical ratio b and
    sqrt(1 - ((r - b)/(1 - b))^2) above it, linear above 0.95.

    Args:
        upstream: p_1 [Pa], absolute, the larger.
        downstream: p_2 [Pa], absolute.
        conductance: C [m3/(s Pa)].
        critical_ratio: b [-].

    Returns:
        Q [m3/s, ANR], dQ/dp_1 and dQ/dp_2 [m3/(s Pa)].

    >>> iso_6358_flow(2e5, 1e5, 1e-8, 0.5)[0]  # choked: C p_1
    0.002
    """
    ratio, width = downstream / upstream, 1.0 - critical_ratio
    share, slope = 1.0, 0.0
    if ratio > critical_ratio:
        x = (min(ratio, SLOW_FLOW) - critical_ratio) / width
        share = math.sqrt(1.0 - x * x)
        if ratio < SLOW_FLOW:
            slope = -x / (width * share)
        else:
            slope = -share / (1.0 - SLOW_FLOW)
            share = slope * (ratio - 1.0)
    flow, by_downstream = conductance * upstream * share, conductance * slope
    return flow, conductance * (share - ratio * slope), by_downstream


@functools.cache
def _kept(time: float, lag: float) -> float:
    """What is left of an error after a time, of a time constant [s]."""
    return math.exp(-time / lag)


@dataclasses.dataclass(frozen=True)
class PneumaticCircuit:
    """Air through a 5/3 proportional valve: fills above the bias, vents below it, leaks at it.

    dP/dt = n (p_anr Q - P_abs dV/dt) / (V + n P_abs dV/dP),  Q = C p_1 psi(p_2 / p_1)

    with psi as in `iso_6358_flow`. Neglected: the gas's temperature (polytropic exponent n), and the
    valve's own dynamics but for a lag.

    Attributes:
        supply: gauge pressure [Pa] (Chambers 2021, section 3.2: 115 psi).
        conductance: sonic conductance C [m3/(s Pa)] of the open valve; ASSUMED, 100 normal litres a
            minute from 6 to 5 bar gauge.
        critical_ratio: b [-]; ASSUMED.
        bias: output at which the valve is closed (2.5 V of 0 to 5 V, chapter 3).
        dead_band: outputs to either side of the bias that open nothing; ASSUMED.
        leak: part of C that stays open to supply and to atmosphere; ASSUMED.
        lag: time constant [s] of the spool; ASSUMED.
        exponent: polytropic n [-], between isothermal 1 and adiabatic 1.4; ASSUMED.
        dead_volume: of hose and fittings [m3]; ASSUMED.
        dump_conductance: C [m3/(s Pa)] of the open dump valve; ASSUMED.
        dump_lag: time constant [s] of its opening and closing; ASSUMED.

    References:
        ISO 6358-1:2013, equations 1 and 2.
    """

    supply: Positive = 115 * PSI
    conductance: Positive = 3.9e-9
    critical_ratio: Annotated[float, Meta(gt=0, lt=SLOW_FLOW)] = 0.3
    bias: int = 128
    dead_band: int = 3
    leak: float = 0.004
    lag: Positive = 0.012
    exponent: Positive = 1.2
    dead_volume: Positive = 5e-6
    dump_conductance: NotNegative = 8e-9
    dump_lag: Positive = 0.015

    def __post_init__(self) -> None:
        check_fields(self, RigError)

    def start(self) -> "RunningPneumatic":
        """The circuit at atmosphere with its valve at rest."""
        return RunningPneumatic(self)


class RunningPneumatic:
    """A pneumatic circuit in operation.

    Attributes:
        circuit: its parameters.
        pressure: gauge pressure P [Pa].
        opening: of the valve, -1 (vent) to 1 (fill).
        dump: opening of the dump valve, 0 to 1.
    """

    def __init__(self, circuit: PneumaticCircuit) -> None:
        self.circuit = circuit
        self.pressure = self.opening = self.dump = 0.0

    def step(
        self, output: int, dump_open: bool, volume: float, rate: float, give: float, dt: float
    ) -> None:
        """Linearly implicit midpoint rule, exact in the lags.

        Valves and volume are taken in the middle of the step, the slopes of the flows at its
        beginning.
        """
        c = self.circuit
        above = output - c.bias
        beyond = max(abs(above) - c.dead_band, 0)
        whole = FULL_OUTPUT - c.bias if above > 0 else c.bias
        target = math.copysign(beyond / (whole - c.dead_band), above)
        keep, keep_dump = _kept(0.5 * dt, c.lag), _kept(0.5 * dt, c.dump_lag)
        wanted, half = float(dump_open), 0.5 * dt
        # How far the valves are from where they go, in the middle of the step.
        behind, dump_behind = (self.opening - target) * keep, (self.dump - wanted) * keep_dump
        opening, b = target + behind, c.critical_ratio
        fill = leak = c.leak * c.conductance
        vent = leak + (wanted + dump_behind) * c.dump_conductance
        if opening > 0.0:
            fill += opening * c.conductance
        else:
            vent -= opening * c.conductance
        gauge, supply = self.pressure, c.supply + ATMOSPHERE
        absolute = gauge + ATMOSPHERE
        if absolute < supply:
            flow, _, slope = iso_6358_flow(supply, absolute, fill, b)
        else:
            back, slope, _ = iso_6358_flow(absolute, supply, fill, b)
            flow, slope = -back, -slope
        if gauge > 0.0:
            out, out_slope, _ = iso_6358_flow(absolute, ATMOSPHERE, vent, b)
        else:
            back, _, out_slope = iso_6358_flow(ATMOSPHERE, absolute, vent, b)
            out, out_slope = -back, -out_slope
        scale = c.exponent / (volume + c.dead_volume + half * rate + c.exponent * absolute * give)
        change = scale * (ANR_PRESSURE * (flow - out) - absolute * rate)
        stiffness = scale * (ANR_PRESSURE * (slope - out_slope) - rate)
        self.pressure = gauge + dt * change / (1.0 - half * stiffness)
        self.opening, self.dump = target + behind * keep, wanted + dump_behind * keep_dump


@dataclasses.dataclass(frozen=True)
class HydraulicCircuit:
    """Water from a gear pump, out through a needle valve: speed sets flow, flow sets pressure.

    (V / beta + dV/dP) dP/dt = D w - K sqrt(P) - dV/dt - relief

    Neglected: inertia of the water, leakage inside the pump (it lets nothing back), and the
    pressure in the return line.

    Attributes:
        displacement: of the pump, D [m3/rev]; ASSUMED.
        full_speed: [rev/s] at output 255 (chapter 3: 5000 rpm).
        lag: time constant [s] of the pump; ASSUMED.
        needle: K [m3/(s Pa^0.5)]; 0 is a blocked needle. ASSUMED: 80 % of full speed holds 100 psi.
        bulk_modulus: beta [Pa] of water, hose and bladder with some air; ASSUMED.
        dead_volume: of hose and fittings [m3]; ASSUMED.
        relief: gauge pressure [Pa] at which the relief valve opens (chapter 3: 110 psi); None
            where there is none. No software takes its place.
        relief_conductance: its flow over the pressure in excess [m3/(s Pa)]; ASSUMED.
        dump: K [m3/(s Pa^0.5)] of the open dump valve; 0 where there is none; ASSUMED.
        dump_lag: time constant [s] of its opening and closing; ASSUMED.
    """

    displacement: Positive = 0.8e-6
    full_speed: Positive = 5000 / 60
    lag: Positive = 0.1
    needle: NotNegative = 0.8 * 0.8e-6 * 5000 / 60 / math.sqrt(100 * PSI)
    bulk_modulus: Positive = 35e6
    dead_volume: Positive = 20e-6
    relief: float | None = 110 * PSI
    relief_conductance: NotNegative = 2e-9
    dump: NotNegative = 4e-7
    dump_lag: Positive = 0.015

    def __post_init__(self) -> None:
        check_fields(self, RigError)

    def steady_output(self, pressure: float) -> float:
        """Output [counts], not rounded, that holds a gauge pressure [Pa] against the needle's flow."""
        full_flow = self.displacement * self.full_speed
        return FULL_OUTPUT * self.needle * math.sqrt(pressure) / full_flow

    def start(self) -> "RunningHydraulic":
        """The circuit at atmosphere with its pump at rest."""
        return RunningHydraulic(self)


class RunningHydraulic:
    """A hydraulic circuit in operation.

    Attributes:
        circuit: its parameters.
        pressure: gauge pressure P [Pa].
        speed: of the pump [rev/s].
        dump: opening of the dump valve, 0 to 1.
    """

    def __init__(self, circuit: HydraulicCircuit) -> None:
        self.circuit = circuit
        self.pressure = self.speed = self.dump = 0.0

    def step(
        self, output: int, dump_open: bool, volume: float, rate: float, give: float, dt: float
    ) -> None:
        """Implicit midpoint rule, exact in the lags.

        With a = (V / beta + dV/dP) / dt and the flows of the pump and of the motion known, the
        pressure s^2 in the middle of the step solves 2 a s^2 + K s = c: a quadratic, which no
        stiffness of the water upsets. Where the pressure would fall through zero, as an open dump
        valve makes it, the end of the step is solved for instead (Euler).
        """
        c = self.circuit
        keep, keep_dump = _kept(0.5 * dt, c.lag), _kept(0.5 * dt, c.dump_lag)
        target, wanted = c.full_speed * output / FULL_OUTPUT, float(dump_open)
        # How far pump and valve are from where they go, in the middle of the step.
        behind, dump_behind = (self.speed - target) * keep, (self.dump - wanted) * keep_dump
        K = c.needle + (wanted + dump_behind) * c.dump
        a = ((volume + c.dead_volume + 0.5 * rate * dt) / c.bulk_modulus + give) / dt
        flow, before = c.displacement * (target + behind) - rate, self.pressure
        end = 2.0 * self._after(2.0 * a, K, 2.0 * a * before + flow) - before
        self.pressure = end if end * before >= 0.0 else self._after(a, K, a * before + flow)
        self.speed, self.dump = target + behind * keep, wanted + dump_behind * keep_dump

    def _after(self, a: float, K: float, c: float) -> float:
        """P of a P + K sqrt(P) + relief = c."""
        pressure, circuit = _after_orifice(a, K, c), self.circuit
        if circuit.relief is not None and pressure > circuit.relief:
            G = circuit.relief_conductance
            pressure = _after_orifice(a + G, K, c + G * circuit.relief)
        return pressure


def _after_orifice(a: float, K: float, c: float) -> float:
    """P = s|s| of a s|s| + K s = c: the orifice passes the same flow either way."""
    s = 2.0 * c / (K + math.sqrt(K * K + 4.0 * a * abs(c)))
    return s * abs(s)


class SimulatedMuscle:
    """Force and volume of a muscle on a grid of lengths and pressures, linear in between.

    Beyond the pressures of the grid both go on in a straight line; beyond its lengths is an error.

    Args:
        lengths: active lengths L [m], rising evenly, shape (n,).
        pressures: gauge pressures P [Pa], rising evenly, shape (m,).
        force: F [N], shape (n, m), positive when the muscle pulls.
        volume: of fluid V [m3], shape (n, m).
        rest_length: L0 [m], within the lengths.
        friction: part of F by which it falls short of the mean while the muscle shortens and
            exceeds it while the muscle lengthens; ASSUMED where it is not measured.
        friction_travel: [m] of motion over which the friction turns round after a reversal; ASSUMED.

    Raises:
        RigError: the shapes do not agree, a volume is not positive, or the rest length is not in the grid.
    """

    def __init__(
        self,
        lengths: Sequence[float] | np.ndarray,
        pressures: Sequence[float] | np.ndarray,
        force: np.ndarray,
        volume: np.ndarray,
        *,
        rest_length: float,
        friction: float = 0.02,
        friction_travel: float = 2e-4,
    ) -> None:
        lengths, pressures = np.asarray(lengths, float), np.asarray(pressures, float)
        pairs = np.stack([np.asarray(force, float), np.asarray(volume, float)], axis=-1)
        if pairs.shape != (lengths.size, pressures.size, 2) or not np.isfinite(pairs).all():
            shape = (lengths.size, pressures.size)
            raise RigError(f"force and volume must be finite with shape {shape}, got {pairs.shape}")
        if (least := pairs[..., 1].min()) <= 0:
            raise RigError(f"volume must be positive, the least is {least:.3g} m3")
        if not lengths[0] < rest_length <= lengths[-1]:
            raise RigError(f"rest_length must lie within the lengths, got {rest_length} m")
        self.lengths, self.pressures, self.rest_length = lengths, pressures, float(rest_length)
        self.friction, self.friction_travel = friction, friction_travel
        self._L0, self._per_L = float(lengths[0]), 1 / float(lengths[1] - lengths[0])
        self._P0, self._per_P = float(pressures[0]), 1 / float(pressures[1] - pressures[0])
        self._last = (lengths.size - 2, pressures.size - 2)
        self._rows: list[list[list[float]]] = pairs.tolist()
        self._cell = self._corners(0, 0)  # the last one used

    def at(self, length: float, pressure: float) -> tuple[float, float, float, float]:
        """Force and volume at an active length L [m] and gauge pressure P [Pa].

        Returns:
            F [N], the mean of shortening and lengthening; V [m3]; dV/dL [m2]; dV/dP [m3/Pa].

        Raises:
            RigError: the length lies outside the table.
        """
        x, y = (length - self._L0) * self._per_L, (pressure - self._P0) * self._per_P
        cell = self._cell
        if not (cell[0] <= x < cell[0] + 1 and cell[1] <= y < cell[1] + 1):
            self._cell = cell = self._corners(*self._cell_of(length, x, y))
        i, j, F, across, F_up, across_up, V, give, V_up, give_up = cell
        x, y = x - i, y - j
        low, high = F + across * y, F_up + across_up * y
        below, over = V + give * y, V_up + give_up * y
        return (
            low + (high - low) * x,
            below + (over - below) * x,
            (over - below) * self._per_L,
            (give + (give_up - give) * x) * self._per_P,
        )

    def _cell_of(self, length: float, x: float, y: float) -> tuple[int, int]:
        """The cell of a point of the grid: beyond its pressures the outermost, beyond its lengths none."""
        i, j = int(x), int(y)
        last_i, last_j = self._last
        if i > last_i or x < 0.0:
            if not -1e-9 <= x <= last_i + 1 + 1e-9:
                raise RigError(
                    f"length {length:.6g} m lies outside the muscle's table, {self.lengths[0]:.6g} "
                    f"to {self.lengths[-1]:.6g} m: shorten the stroke or widen the table"
                )
            i = last_i if i > last_i else 0
        return i, 0 if j < 0 else j if j < last_j else last_j

    def _corners(self, i: int, j: int) -> tuple[int, int, *tuple[float, ...]]:
        """i, j; of F and then of V, at the lower and the upper length: value, step to the next P."""
        (F, V), (F_right, V_right) = self._rows[i][j : j + 2]
        (F_up, V_up), (F_far, V_far) = self._rows[i + 1][j : j + 2]
        return i, j, F, F_right - F, F_up, F_far - F_up, V, V_right - V, V_up, V_far - V_up

    def force(self, length: float, pressure: float) -> float:
        """F [N] of `at`."""
        return self.at(length, pressure)[0]


def mckibben(
    *,
    rest_length: float = 9.28125 * INCH,
    thread_length: float = 9.89 * INCH,
    turns: float = 1.09,
    solid_volume: float = 1.754 * INCH**3,
    stiffness: float = 22.6 * LBF / INCH,
    deadband_pressure: float = 3.3 * PSI,
    friction: float = 0.02,
) -> SimulatedMuscle:
    """A muscle with an inelastic braid and a linear bladder, for a rig without a muscle model.

    V = (B^2 L - L^3) / (4 pi N^2) - V_solid,  F = max(P - P_d, 0) (3 L^2 - B^2) / (4 pi N^2) - k (L0 - L)

    The defaults are the reference work's 7/8 in muscle; stiffness and deadband were chosen to come
    within 5 % of its printed blocked force, and within 0.03 of its free contraction from 40 psi.

    Args:
        rest_length: L0 [m].
        thread_length: B [m].
        turns: N of one thread.
        solid_volume: of bladder and braid [m3], in which there is no fluid.
        stiffness: k [N/m] of the bladder; ASSUMED.
        deadband_pressure: P_d [Pa]; ASSUMED.
        friction: see `SimulatedMuscle`; ASSUMED.

    Returns:
        The muscle, tabulated from just beyond the neutral angle to 2 % above L0.

    Raises:
        RigError: L0 is not between the neutral angle and the thread's own length.

    References:
        Chambers 2021, tables 6.11 and 6.12.
    """
    neutral = thread_length / math.sqrt(3)
    four = 4 * math.pi * turns**2
    longest = min(1.02 * rest_length, (rest_length + thread_length) / 2)
    lengths = np.linspace(0.95 * neutral, longest, 401)[:, None]
    pressures = np.linspace(0, 120 * PSI, 121)[None, :]
    area = (3 * lengths**2 - thread_length**2) / four
    pull = np.maximum(pressures - deadband_pressure, 0.0) * area - stiffness * (
        rest_length - lengths
    )
    volume = (thread_length**2 * lengths - lengths**3) / four - solid_volume
    volume = np.broadcast_to(volume, pull.shape)
    return SimulatedMuscle(
        lengths[:, 0], pressures[0], pull, volume, rest_length=rest_length, friction=friction
    )


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
        """The true time [s] of a reading [s]."""
        return (reading - self.offset) / (1 + self.rate)


class TestMachine:
    """A screw-driven machine that shortens and lengthens a muscle at constant rate.

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
        rows: of its log: time [s] of its own clock, displacement [m], negative where the muscle is shorter
            than at rest, force [N], sync.
    """

    __test__ = False  # not a test of pytest's

    def __init__(
        self,
        rest_length: float,
        *,
        shortest: float,
        clock: MachineClock | None = None,
        log_interval: float = 0.02,
        load_noise: float = 0.3 * LBF,
        seed: int = 0,
    ) -> None:
        self.rest_length, self.shortest = rest_length, shortest
        self.clock = clock or MachineClock()
        self.log_interval, self.load_noise = log_interval, load_noise
        self.length = rest_length
        self.velocity = 0.0
        self.sync = False
        self.cycles_left = 0
        self._program = (0.0, shortest, 0.0)
        self._rng = np.random.default_rng(seed)
        self.rows: list[tuple[float, float, float, float]] = []
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
        """Begin strokes from the rest length, or add more to those under way.

        Args:
            cycles: number of strokes there and back.
            rate: of the crosshead [m/s] (chapter 4: 0.04 in/s).
            stroke: [m] after which it turns at the latest; the limit switch where None.
            turn_load: [N] to which the load falls before it turns.

        Raises:
            RigError: other strokes are under way, or the numbers make no stroke.
        """
        longest = self.rest_length - self.shortest
        if stroke is not None and not 0 < stroke <= longest:
            raise RigError(f"stroke must lie in (0, {longest:.5g}] m, got {stroke} m")
        turn_at = self.shortest if stroke is None else self.rest_length - stroke
        program = (rate, turn_at, turn_load)
        if not self.busy:
            self._program, self.velocity = program, -rate
        elif program != self._program:
            raise RigError("the machine is busy with other strokes: wait for them")
        self.cycles_left += cycles

    def step(self, now: float, dt: float, load: float) -> None:
        """Move for dt [s] up to the true time `now` [s], under the load [N] at the start."""
        velocity = self.velocity
        length = self.length + velocity * dt
        if velocity < 0:
            rate, turn_at, turn_load = self._program
            if load <= turn_load or length <= turn_at:
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
        self.rows.append((self._next_row, x - self.rest_length, force, float(self.sync)))
        self._next_row += self.log_interval
        self._next_at = self.clock.true_time(self._next_row)

    def write_log(self, path: str | Path) -> Path:
        """Write the log as a delimited file with units."""
        lines = ["Time,Extension,Load,Digital input", "(s),(mm),(N),(-)"]
        for time, displacement, force, sync in self.rows:
            lines.append(f"{time:.4f},{displacement * 1e3:.5f},{force:.4f},{sync:.0f}")
        path = Path(path)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path


class Plant:
    """Circuit, muscle and machine, stepped together.

    Neglected: inertia of muscle and crosshead, and the pressure drop between circuit and muscle.
    Ticks of 2 ms are within 0.02 psi (air) and 0.04 psi (water) of steps forty times finer over a
    whole test, 0.004 and 0.001 psi in the root mean square; within 0.2 psi while water is dumped.

    Attributes:
        circuit: in operation; its `pressure` [Pa] is the muscle's.
        muscle: force and volume.
        machine: which holds and moves the muscle.
        force: pull [N] of the muscle with its friction.
    """

    def __init__(self, circuit: Any, muscle: SimulatedMuscle, machine: TestMachine) -> None:
        self.circuit, self.muscle, self.machine = circuit, muscle, machine
        self._slide = 0.0  # friction's direction, -1 while shortening to 1 while lengthening
        self._held = muscle.at(machine.length, circuit.pressure)
        self.force = self._held[0]

    def step(self, now: float, dt: float, output: int, dump_open: bool) -> None:
        """Advance to the true time `now` [s] by dt [s] under a held output [counts]."""
        circuit, machine, muscle = self.circuit, self.machine, self.muscle
        velocity = machine.velocity
        _, volume, area, give = self._held
        circuit.step(output, dump_open, volume, area * velocity, give, dt)
        machine.step(now, dt, self.force)
        if velocity:
            # Dahl's law along the way, to first order in a step of micrometres.
            moved = abs(velocity) * dt / muscle.friction_travel
            towards = 1.0 if velocity > 0 else -1.0
            self._slide += (towards - self._slide) * (moved if moved < 1.0 else 1.0)
        self._held = held = muscle.at(machine.length, circuit.pressure)
        mean = held[0]
        self.force = mean + muscle.friction * self._slide * abs(mean)
