"""Inverse maps and control: pressures for forces, joints, tracked lengths.

Every function answers a batch, with a code in place of an exception: see `Outcome`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
