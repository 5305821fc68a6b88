"""Inverse maps and control: pressures required for forces, joint torques and tracked lengths.

Every function accepts a batch of states, and returns a code instead of raising an exception; see
`Outcome`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
