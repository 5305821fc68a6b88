"""Force maps: readings with units, specimens, levels of pressure and length, CSV files.

`read_csv` reads a map, `load_bundled` one that is shipped.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
