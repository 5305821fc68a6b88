"""Published static force models in SI, to evaluate, differentiate and compare with.

Each is a `PeerModel`, or a `famjax.Muscle` where it is one, with `force(length, pressure)`. Every
docstring says whether its form was read or is general knowledge. Braid angles are measured from
the circumference, contraction is a fraction, pressure is gauge.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
