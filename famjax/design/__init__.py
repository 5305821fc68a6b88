"""Design muscles from a catalogue of braids, bladders, swage tubes and end-fittings.

Start with `load_catalogue` and `search`; `size_end_fittings` calculates the sizes of the swaged ends.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
