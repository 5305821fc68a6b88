"""Shapes of a muscle: the diameter along the active length, D(z).

`FourierProfile` is one shape; a family gives the shape at each length and pressure, between shapes
that were measured (`MeasuredFamily`) or by an assumption about the ends (`AssumedShapeFamily`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
