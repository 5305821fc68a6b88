"""Input and output shared by the packages: units, files, and errors for bad input.

This is the only part of famjax that `imaging` and `rig` import. It contains no JAX and no physics.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
