"""The boundary of the packages: units, files, and errors for bad input.

No JAX and no physics: of famjax, this is the one room that `imaging` and `rig` import.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
