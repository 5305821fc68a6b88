from .columns import UNIT_OF as UNIT_OF, clocks as clocks, table as table
from .formats import (
    convert as convert,
    to_xarray as to_xarray,
    write_netcdf as write_netcdf,
)
