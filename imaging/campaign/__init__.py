"""Many pictures to one table: workers, resumption, plots, and pictures to check by eye.

`process` takes any executor and goes on where it was stopped; `Table` writes CSV, NetCDF, Parquet.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
