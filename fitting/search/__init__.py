"""The search for a muscle: `identify`, from many starts, with the convex fit inside."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
