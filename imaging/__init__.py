"""From photographs of a muscle to its shape D(z), each figure with its error.

Pictures: u to the right, v downwards, in px, pixel centres at the integers. World: metres, the
camera at the origin, X to the right, Y downwards, Z away from the camera. `z` runs along the
muscle from the upper tape's edge; the length L is that between the inner edges of the two tapes.
Start with `measure` (one picture) or `process` (many).
"""

import lazy_loader

__famjax__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
