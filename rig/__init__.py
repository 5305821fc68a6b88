"""Microcontroller to record of a test: protocol, link, journal, plan, simulation, analysis."""

import importlib
from typing import TYPE_CHECKING, Any

from ._abstract_link import AbstractLink as AbstractLink
from ._alignment import (
    Alignment as Alignment,
    align_by_load as align_by_load,
    align_by_pulses as align_by_pulses,
)
from ._analysis import Analysis as Analysis, analyse as analyse
from ._audit import Audit as Audit, audit as audit
from ._calibration import (
    Calibration as Calibration,
    calibration_as_dict as calibration_as_dict,
    calibration_from_dict as calibration_from_dict,
    read_calibration as read_calibration,
    write_calibration as write_calibration,
)
from ._characterisation import (
    Characterisation as Characterisation,
    Isobar as Isobar,
    characterise as characterise,
    force_rmse as force_rmse,
)
from ._clock import ClockMap as ClockMap, fit_clock as fit_clock
from ._command_queue import Command as Command
from ._commands import (
    convert as convert,
    need_port as need_port,
    ports as ports,
    quantity as quantity,
    run_test as run_test,
    specimen_entries as specimen_entries,
)
from ._control import Control as Control
from ._control_law import (
    ControlLaw as ControlLaw,
    drive as drive,
    next_integral as next_integral,
    pressure_error as pressure_error,
)
from ._dataset import dataset_text as dataset_text, write_dataset as write_dataset
from ._device import BAUD_RATES as BAUD_RATES, Device as Device
from ._errors import RigError as RigError
from ._events import (
    Event as Event,
    Lost as Lost,
    Reset as Reset,
    Silent as Silent,
    Timing as Timing,
)
from ._fault import RigFault as RigFault
from ._feed_forward import FeedForward as FeedForward, fit_feed_forward as fit_feed_forward
from ._isobaric_record import IsobaricRecord as IsobaricRecord, combine as combine
from ._journal import Journal as Journal
from ._journal_reader import (
    Missing as Missing,
    Record as Record,
    read_journal as read_journal,
)
from ._link import Link as Link, Port as Port, serial_opener as serial_opener
from ._machine_log import (
    Gap as Gap,
    MachineLog as MachineLog,
    read_machine_log as read_machine_log,
)
from ._messages import (
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
from ._monitor import Monitor as Monitor
from ._native_device import (
    NativeDevice as NativeDevice,
    build_native as build_native,
    firmware_folder as firmware_folder,
)
from ._plan import (
    Isobaric as Isobaric,
    Plan as Plan,
    Step as Step,
    describe as describe,
    duration as duration,
    highest_pressure as highest_pressure,
    isobaric_from_dict as isobaric_from_dict,
    next_block as next_block,
)
from ._plan_file import (
    PRECONDITIONS as PRECONDITIONS,
    PlanFile as PlanFile,
    read_plan as read_plan,
)
from ._protocol import (
    Splitter as Splitter,
    command_body as command_body,
    crc16 as crc16,
    frame as frame,
    parse as parse,
)
from ._rig import Rig as Rig
from ._run import (
    Machine as Machine,
    calibrate_feed_forward as calibrate_feed_forward,
    run as run,
)
from ._sensor import Sensor as Sensor, fit_sensor as fit_sensor
from ._session import Session as Session
from ._strokes import Stroke as Stroke, strokes as strokes
from ._tables import (
    clocks as clocks,
    stored_calibration as stored_calibration,
    table as table,
    to_xarray as to_xarray,
    write_netcdf as write_netcdf,
    write_parquet as write_parquet,
)
from ._test_table import figures as figures, table_rows as table_rows
from ._virtual_link import VirtualLink as VirtualLink

if TYPE_CHECKING:
    from ._characterisation_plot import plot_characterisation as plot_characterisation

__famjax__ = "0.1.0"

_NEED_MATPLOTLIB = {"plot_characterisation": "_characterisation_plot"}


def __getattr__(name: str) -> Any:
    """Load plots, and with them matplotlib, only when they are used."""
    if name in _NEED_MATPLOTLIB:
        return getattr(importlib.import_module(f".{_NEED_MATPLOTLIB[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
