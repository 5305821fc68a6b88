"""Search of a space of designs: pairs of a catalogue at every rest length, pressure and braid angle.

Start with `search_space`; `SearchLimits` are what it keeps to beside the requirement, `SearchRanges`
what it varies.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
