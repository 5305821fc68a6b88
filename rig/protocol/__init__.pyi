from .control_law import (
    PRESSURE_UNIT as PRESSURE_UNIT,
    TICK_HZ as TICK_HZ,
    TICKS as TICKS,
    ControlLaw as ControlLaw,
    drive as drive,
    next_integral as next_integral,
    pressure_error as pressure_error,
)
from .lines import (
    Splitter as Splitter,
    command_body as command_body,
    crc16 as crc16,
    frame as frame,
    parse as parse,
)
from .messages import (
    DRIVEN as DRIVEN,
    FAULTS as FAULTS,
    MANUAL as MANUAL,
    RUN as RUN,
    SAFE as SAFE,
    STATES as STATES,
    TRIP as TRIP,
    Ack as Ack,
    Comment as Comment,
    DeviceSettings as DeviceSettings,
    DeviceStatus as DeviceStatus,
    Hello as Hello,
    Message as Message,
    Sample as Sample,
    StoredRange as StoredRange,
)
