from .channel import ByteChannel as ByteChannel
from .circuits import RunningCircuit as RunningCircuit
from .hydraulic import HydraulicCircuit as HydraulicCircuit, RunningHydraulic as RunningHydraulic
from .machine import MachineClock as MachineClock, TestMachine as TestMachine
from .muscle import SimulatedMuscle as SimulatedMuscle, mckibben as mckibben
from .orifice import SLOW_FLOW as SLOW_FLOW, iso_6358_flow as iso_6358_flow
from .plant import Plant as Plant
from .pneumatic import PneumaticCircuit as PneumaticCircuit, RunningPneumatic as RunningPneumatic
from .sensors import (
    SimulatedSensor as SimulatedSensor,
    load_cell as load_cell,
    pressure_transducer as pressure_transducer,
)
from .server import RigServer as RigServer
from .simulated_rig import (
    CIRCUITS as CIRCUITS,
    SimulatedRig as SimulatedRig,
    machine_for as machine_for,
)
