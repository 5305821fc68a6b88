from .clock import ClockMap as ClockMap, fit_clock as fit_clock
from .law_audit import Audit as Audit, audit as audit
from .reader import Missing as Missing, Record as Record, read_journal as read_journal
from .tables import (
    UNIT_OF as UNIT_OF,
    clocks as clocks,
    convert as convert,
    stored_calibration as stored_calibration,
    table as table,
    to_xarray as to_xarray,
    write_netcdf as write_netcdf,
    write_parquet as write_parquet,
)
from .writer import Journal as Journal
