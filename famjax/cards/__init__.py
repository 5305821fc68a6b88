"""Convert a muscle to plain data with units in the keys, and back. This does not require a fit."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
