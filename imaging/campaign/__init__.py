"""Many pictures to one table: workers and resumption; `famjax.chain` plots it for a check by eye.

`process` takes any executor and goes on where it was stopped; `Table` writes CSV, NetCDF, Parquet.
"""

from famjax.boundary.public_names import attach_rooms

_MOVED = {
    "famjax.chain": ("Tile", "contact_sheet", "expand", "plot_table", "write_check_pictures"),
    "famjax.chain.check_pictures": ("choose",),
}

__getattr__, __dir__, __all__ = attach_rooms(__name__, __file__, _MOVED)
