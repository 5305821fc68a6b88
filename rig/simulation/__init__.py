"""A rig without hardware: circuits, muscle, sensors, test machine, serial line, device."""

from ._channel import ByteChannel as ByteChannel
from ._circuits import RunningCircuit as RunningCircuit
from ._hydraulic import HydraulicCircuit as HydraulicCircuit, RunningHydraulic as RunningHydraulic
from ._machine import MachineClock as MachineClock, TestMachine as TestMachine
from ._muscle import (
    SimulatedMuscle as SimulatedMuscle,
    mckibben as mckibben,
    tabulate as tabulate,
)
from ._orifice import iso_6358_flow as iso_6358_flow
from ._plant import Plant as Plant
from ._pneumatic import (
    PneumaticCircuit as PneumaticCircuit,
    RunningPneumatic as RunningPneumatic,
)
from ._regulator import Regulator as Regulator, RunningRegulator as RunningRegulator
from ._sensors import (
    SimulatedSensor as SimulatedSensor,
    load_cell as load_cell,
    pressure_transducer as pressure_transducer,
)
from ._server import RigServer as RigServer
from ._simulated_rig import SimulatedRig as SimulatedRig, machine_for as machine_for
from ._simulated_test import SimulatedTest as SimulatedTest, simulate as simulate
