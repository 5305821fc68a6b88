"""The two edges of the muscle to a fraction of a pixel, by a model of the lit limb under blur."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
