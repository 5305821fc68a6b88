"""Published static force models in SI units, which can be evaluated, differentiated and compared.

Each model has `force(length, pressure)`. It is a `famjax.Muscle` if its form allows, otherwise a
`PeerModel`. Each docstring states whether the formula was read in a publication or is general
knowledge. Braid angles are measured from the circumference, contraction is a fraction, and pressure is
gauge pressure.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
