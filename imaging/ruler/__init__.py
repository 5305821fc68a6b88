"""The scale of a picture from the photograph of a ruler in the muscle's place."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
