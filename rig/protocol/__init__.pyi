from .control_law import (
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
    FAULTS as FAULTS,
    MANUAL as MANUAL,
    RUN as RUN,
    SAFE as SAFE,
    STATES as STATES,
    TRIP as TRIP,
    Ack as Ack,
    Comment as Comment,
    Hello as Hello,
    Limits as Limits,
    Message as Message,
    Sample as Sample,
    Settings as Settings,
    Status as Status,
)
