"""A journal's columns as a dataset, as NetCDF or CSV."""

import csv
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from famjax.boundary.extras import import_extra
from rig.errors import RigError
from rig.journal import Record, read_journal

from .columns import UNIT_OF, table

if TYPE_CHECKING:
    import xarray


def to_xarray(record: Record) -> "xarray.Dataset":
    """The table as a dataset over time, with the unit of each variable as its attribute.

    Raises:
        RigError: xarray is not installed, or as `table`.
    """
    xarray = import_extra("xarray", "tables", RigError)
    columns = table(record)
    variables = {
        name: ("time_s", values, {"units": UNIT_OF[name]})
        for name, values in columns.items()
        if name != "time_s"
    }
    coordinates = {"time_s": ("time_s", columns["time_s"], {"units": "s"})}
    return xarray.Dataset(variables, coordinates, attrs={"source": record.path.name})


def write_netcdf(record: Record, path: str | Path) -> None:
    """Write the table as NetCDF 3, the unit of each variable as its attribute.

    Raises:
        RigError: as `to_xarray`.
    """
    dataset = to_xarray(record)
    small = {name: v.astype(np.int32) for name, v in dataset.items() if v.dtype.kind == "i"}
    dataset.assign({n: v.assign_attrs(dataset[n].attrs) for n, v in small.items()}).to_netcdf(
        path, engine="scipy", format="NETCDF3_64BIT"
    )


def convert(journal: str | Path, target: str | Path) -> Path:
    """The records of a journal as a table: NetCDF or CSV, by the target's ending.

    Raises:
        RigError: another ending, or the journal cannot be read.
    """
    target = Path(target)
    record = read_journal(journal)
    if target.suffix == ".nc":
        write_netcdf(record, target)
        return target
    if target.suffix != ".csv":
        raise RigError(f"the target must end in .nc or .csv, got {target.name!r}")
    columns = table(record)
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return target
