"""A rig's journal as columns in SI on the host's clock, and as files for other programs.

`table` gives the columns, `convert` writes them as NetCDF or CSV.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
