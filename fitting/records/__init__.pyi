from .clock import (
    Alignment as Alignment,
    ClockMap as ClockMap,
    align_by_load as align_by_load,
    fit_clock as fit_clock,
)
from .force_map import (
    StaticMap as StaticMap,
    branches_csv as branches_csv,
    ramp_pairs as ramp_pairs,
    ramps_command as ramps_command,
    read_branches as read_branches,
    read_ramps as read_ramps,
    static_map as static_map,
)
from .hysteresis import (
    BranchPairs as BranchPairs,
    History as History,
    HysteresisFit as HysteresisFit,
    HysteresisLeftOut as HysteresisLeftOut,
    fit_hysteresis as fit_hysteresis,
    hysteresis_as_dict as hysteresis_as_dict,
    hysteresis_table as hysteresis_table,
    hysteresis_warnings as hysteresis_warnings,
    leave_out as leave_out,
    read_history as read_history,
)
from .isobar import (
    Characterisation as Characterisation,
    Isobar as Isobar,
    IsobaricRecord as IsobaricRecord,
    characterise as characterise,
    combine as combine,
    strokes as strokes,
    write_dataset as write_dataset,
)
from .motion import (
    OtherMotion as OtherMotion,
    SyncError as SyncError,
    Synchronisation as Synchronisation,
    synchronise as synchronise,
)
from .ramp import (
    QuasiStatic as QuasiStatic,
    RampRecord as RampRecord,
    find_staircase as find_staircase,
    quasi_static as quasi_static,
    read_ramp as read_ramp,
)
from .record import MachineLog as MachineLog, read_machine_log as read_machine_log
