"""Tests of bladder and thread: tensile cycles, hysteresis loops, moduli in the muscle."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
