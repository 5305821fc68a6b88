"""Fits on the disk: `write_fit`, `load_fit`, the report and its picture; the card of a fit."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
