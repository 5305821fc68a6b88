"""The dimensions of braid and bladder at a length and a pressure, from what is known of the shape.

`EstimatedGeometry` is a cylinder in its braid; `MeasuredGeometry` and `AverageDiameterGeometry` take
a family of profiles; `EndEffectGeometry` corrects a cylinder for its ends. All return `Dimensions`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
