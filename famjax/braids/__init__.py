"""The braid: threads in two helices, their length and angle, and what pressure makes of them.

Start with `Braid` (inextensible threads) or `ElasticBraid`; `gaylord_force` is the pull of the braid
alone. Angles are measured from the circumference: L = B sin(theta), pi N D = B cos(theta).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
