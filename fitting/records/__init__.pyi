from .alignment import (
    Alignment as Alignment,
    align_by_load as align_by_load,
    align_by_pulses as align_by_pulses,
)
from .characterisation import (
    Characterisation as Characterisation,
    Isobar as Isobar,
    characterise as characterise,
    force_rmse as force_rmse,
)
from .clock import ClockMap as ClockMap, fit_clock as fit_clock
from .dataset import dataset_text as dataset_text, write_dataset as write_dataset
from .isobaric_record import IsobaricRecord as IsobaricRecord, combine as combine
from .machine_log import Gap as Gap, MachineLog as MachineLog, read_machine_log as read_machine_log
from .motion_match import (
    OtherMotion as OtherMotion,
    SyncError as SyncError,
    Synchronisation as Synchronisation,
    synchronise as synchronise,
)
from .stroke import Stroke as Stroke, strokes as strokes
