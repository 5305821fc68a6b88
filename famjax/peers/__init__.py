"""Published static force models in SI units, for evaluation, differentiation and comparison.

Each has `force(length, pressure)` and is a `PeerModel`, or a `famjax.Muscle` where its form allows.
Each docstring states whether the formula was read in a publication or is general knowledge. Braid
angles are measured from the circumference, contraction is a fraction, and pressure is gauge.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
