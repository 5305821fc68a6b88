"""All permutations of order, pressure dependence and constraint at one geometry: `sweep`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
