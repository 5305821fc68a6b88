"""Whatever has a force: the muscle, what a rig measures of it, and the base of every other model."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
