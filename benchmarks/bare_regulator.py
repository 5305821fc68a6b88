"""A bare pressure regulator: what the reference work's controller is compared with."""

import dataclasses

from famjax.boundary.toml_file import NotNegative, Positive, check_fields
from famjax.units import PSI
from rig.errors import RigError
from rig.plant import ANR_PRESSURE, ATMOSPHERE

_NORMAL_LITRE_PER_MINUTE = 1e-3 / 60  # m3/s, ANR


@dataclasses.dataclass(frozen=True)
class Regulator:
    """A relieving regulator with droop on the muscle's line and nothing that closes a loop on it.

    It feeds Q = (P_set - P) / droop below its setting and relieves Q = (P - P_set - zone) / droop
    above a dead zone; in between it does nothing, and a moving muscle compresses or expands its
    own gas: the several psi of Figures 3.3 and 3.4.

    Attributes:
        set_pressure: P_set, gauge [Pa].
        dead_zone: between feeding and relieving [Pa]; ASSUMED.
        feed_droop: pressure lost over the flow fed [Pa s/m3, ANR]; ASSUMED.
        relief_droop: pressure gained over the flow relieved [Pa s/m3, ANR]; ASSUMED.
        exponent: polytropic n [-]; ASSUMED.
        dead_volume: [m3]; ASSUMED.

    References:
        Chambers 2021, figures 3.3 and 3.4.
    """

    set_pressure: Positive
    dead_zone: NotNegative = 3.0 * PSI
    feed_droop: Positive = 1.2 * PSI / _NORMAL_LITRE_PER_MINUTE
    relief_droop: Positive = 2.5 * PSI / _NORMAL_LITRE_PER_MINUTE
    exponent: Positive = 1.2
    dead_volume: Positive = 5e-6

    def __post_init__(self) -> None:
        check_fields(self, RigError)

    def start(self) -> "RunningRegulator":
        """The regulator on an empty line."""
        return RunningRegulator(self)


class RunningRegulator:
    """A bare regulator in operation.

    Attributes:
        circuit: its parameters.
        pressure: gauge pressure P [Pa].
    """

    __slots__ = ("circuit", "pressure")

    def __init__(self, circuit: Regulator) -> None:
        self.circuit = circuit
        self.pressure = 0.0

    def step(
        self, output: int, dump_open: bool, volume: float, rate: float, give: float, dt: float
    ) -> None:
        """Linearly implicit midpoint rule; see `RunningCircuit.step`. The output is ignored."""
        del output, dump_open
        c = self.circuit
        gauge, half = self.pressure, 0.5 * dt
        error = c.set_pressure - gauge
        if error > 0:
            flow, slope = error / c.feed_droop, -1 / c.feed_droop
        elif error < -c.dead_zone:
            flow, slope = (error + c.dead_zone) / c.relief_droop, -1 / c.relief_droop
        else:
            flow = slope = 0.0
        absolute = gauge + ATMOSPHERE
        scale = c.exponent / (volume + c.dead_volume + half * rate + c.exponent * absolute * give)
        change = scale * (ANR_PRESSURE * flow - absolute * rate)
        self.pressure += dt * change / (1.0 - half * scale * (ANR_PRESSURE * slope - rate))
