"""Pictures and the camera that took them: files, tone curve, pinhole with distortion, times."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
