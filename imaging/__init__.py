"""Measure the shape D(z) of a muscle in photographs, with a standard error for each value.

Picture coordinates [px]: u to the right, v downwards, pixel centres at integers. World coordinates [m]:
camera at the origin, X to the right, Y downwards, Z away from the camera. `z` runs along the muscle
from the inner edge of the upper tape; the length L is the distance between the inner edges of the two
tapes. Start with `measure` (one picture) or `process` (many).
"""

import lazy_loader

__famjax__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
