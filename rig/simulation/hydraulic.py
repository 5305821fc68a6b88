"""The hydraulic circuit: a gear pump against a needle valve."""

import dataclasses
import math

from famjax.boundary.toml_file import NotNegative, Positive, check_fields

from ..calibration.feed_forward import FULL_OUTPUT
from ..errors import RigError
from .circuits import PSI


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
        """Output [counts], not rounded, whose flow the needle passes at a gauge pressure [Pa]."""
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
        self._keep = (0.0, 0.0, 0.0)

    def step(
        self, output: int, dump_open: bool, volume: float, rate: float, give: float, dt: float
    ) -> None:
        """Implicit midpoint rule, exact in the lags; see `RunningCircuit.step`.

        With a = (V / beta + dV/dP) / dt and the flows of the pump and of the motion known, the
        pressure s^2 in the middle of the step solves 2 a s^2 + K s = c: a quadratic, which no
        stiffness of the water upsets. Where the pressure would fall through zero, as an open dump
        valve makes it, the end of the step is solved for instead (Euler).
        """
        c = self.circuit
        if self._keep[0] != dt:
            self._keep = (dt, math.exp(-0.5 * dt / c.lag), math.exp(-0.5 * dt / c.dump_lag))
        _, keep, keep_dump = self._keep
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
