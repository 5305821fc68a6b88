"""The interface of the pressure circuits of a simulated rig, and their constants.

A circuit is a lumped volume of one pressure. Parameters that the reference work does not print are
ASSUMED and say so.
"""

from typing import Protocol

PSI = 6894.757293168361
"""Pascals per pound-force per square inch."""

ATMOSPHERE = 101325.0
"""Ambient pressure [Pa], absolute."""

ANR_PRESSURE = 1e5
"""Pressure [Pa] of the reference atmosphere in which ISO 6358 states volume flow."""


class RunningCircuit(Protocol):
    """A circuit in operation: it holds a pressure and is stepped in time.

    Attributes:
        pressure: gauge pressure P [Pa] in the muscle.
    """

    pressure: float

    def step(
        self, output: int, dump_open: bool, volume: float, rate: float, give: float, dt: float
    ) -> None:
        """Advance by dt, a tick of the device or less, by a rule of second order.

        Args:
            output: of the controller, 0 to 255.
            dump_open: whether the dump valve is open.
            volume: V [m3] that the fluid fills at the beginning.
            rate: change of V [m3/s] by motion, at constant pressure.
            give: dV/dP [m3/Pa] at constant length, >= 0.
            dt: [s].
        """
        ...
