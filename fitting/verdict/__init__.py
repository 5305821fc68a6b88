"""Whether a fit may be believed, and what is wrong with a force map that no muscle explains."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
