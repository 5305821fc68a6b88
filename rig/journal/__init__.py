"""The record of a test: written line by line, read back verified, checked against the control law.

`Journal` writes, `read_journal` reads, `audit` checks. `famjax.chain.journals` gives columns in SI on
the host's clock.
"""

from famjax.boundary.public_names import attach_rooms

_MOVED = {
    "famjax.chain.journals": (
        "UNIT_OF", "clocks", "convert", "table", "to_xarray", "write_netcdf", "write_parquet",
    ),
    "fitting.records": ("ClockMap", "fit_clock"),
}  # fmt: skip

__getattr__, __dir__, __all__ = attach_rooms(__name__, __file__, _MOVED)
