"""Identify fluidic artificial muscles: fit a certified model to measured data with units.

Start with `read_csv` or `load_bundled`, then `identify`. `validate`, `profile` and `bootstrap` show how
far the result can be trusted, and `compare` compares it with published models. `fitting.records`
converts raw test records to force maps and hysteresis models.
"""

import lazy_loader

__famjax__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
