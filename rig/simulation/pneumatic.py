"""The pneumatic circuit: a proportional valve between supply, muscle and atmosphere."""

import dataclasses
import math

from famjax.boundary.toml_file import NotNegative, Positive, check_fields

from ..calibration.feed_forward import FULL_OUTPUT
from ..errors import RigError
from .circuits import ANR_PRESSURE, ATMOSPHERE, PSI
from .orifice import SLOW_FLOW, iso_6358_flow, share_of_sonic


@dataclasses.dataclass(frozen=True)
class PneumaticCircuit:
    """Air through a 5/3 proportional valve: fills above the bias, vents below it, leaks at it.

    dP/dt = n (p_anr Q - P_abs dV/dt) / (V + n P_abs dV/dP),  Q = C p_1 psi(p_2 / p_1)

    with psi = 1 up to the critical ratio b, sqrt(1 - ((r - b)/(1 - b))^2) above it, and linear above
    0.95. Neglected: the gas's temperature (polytropic exponent n), and the valve's own dynamics
    but for a lag.

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
    critical_ratio: float = 0.3
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
        if not 0 < self.critical_ratio < SLOW_FLOW:
            raise RigError(f"critical_ratio must lie in (0, 0.95), got {self.critical_ratio}")

    def steady_output(self, pressure: float) -> float:  # noqa: ARG002 -- one signature for both
        """Output [counts] that holds a pressure at rest: the bias."""
        return float(self.bias)

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
        self._keep = (0.0, 0.0, 0.0)  # dt, what half of it leaves of the valves' errors

    def step(
        self, output: int, dump_open: bool, volume: float, rate: float, give: float, dt: float
    ) -> None:
        """Linearly implicit midpoint rule, exact in the lags; see `RunningCircuit.step`.

        Valves and volume are taken in the middle of the step, the slopes of the flows at its
        beginning.
        """
        c = self.circuit
        above = output - c.bias
        if above > c.dead_band:
            target = (above - c.dead_band) / (FULL_OUTPUT - c.bias - c.dead_band)
        elif above < -c.dead_band:
            target = (above + c.dead_band) / (c.bias - c.dead_band)
        else:
            target = 0.0
        if self._keep[0] != dt:
            self._keep = (dt, math.exp(-0.5 * dt / c.lag), math.exp(-0.5 * dt / c.dump_lag))
        _, keep, keep_dump = self._keep
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
            share, bend = share_of_sonic(absolute / supply, b)
            flow, slope = fill * supply * share, fill * bend
        else:
            back, slope, _ = iso_6358_flow(absolute, supply, fill, b)
            flow, slope = -back, -slope
        if gauge > 0.0:
            ratio = ATMOSPHERE / absolute
            share, bend = share_of_sonic(ratio, b) if ratio > b else (1.0, 0.0)
            out, out_slope = vent * absolute * share, vent * (share - ratio * bend)
        else:
            back, _, out_slope = iso_6358_flow(ATMOSPHERE, absolute, vent, b)
            out, out_slope = -back, -out_slope
        scale = c.exponent / (volume + c.dead_volume + half * rate + c.exponent * absolute * give)
        change = scale * (ANR_PRESSURE * (flow - out) - absolute * rate)
        stiffness = scale * (ANR_PRESSURE * (slope - out_slope) - rate)
        self.pressure = gauge + dt * change / (1.0 - half * stiffness)
        self.opening, self.dump = target + behind * keep, wanted + dump_behind * keep_dump
