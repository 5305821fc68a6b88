from .core import (
    BAUD_RATES as BAUD_RATES,
    POWER_ON as POWER_ON,
    TRIP_CEILING as TRIP_CEILING,
    Device as Device,
    Memory as Memory,
    firmware_folder as firmware_folder,
)
from .host_line import ARGUMENTS as ARGUMENTS
from .state_machine import Latch as Latch
