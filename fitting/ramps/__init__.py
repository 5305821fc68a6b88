"""Raw pressure ramps at fixed length to a static force map: `read_ramp`, `quasi_static`, `static_map`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
