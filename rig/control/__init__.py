"""A test as an operator sees it: plan, limits, calibration, the run.

`read_plan` reads a plan, `Rig` is pressure control that vents on every way out, `run` carries out a plan.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
