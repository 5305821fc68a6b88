"""Identification of fluidic artificial muscles: data with units in, a certified model out.

Start with `read_csv` or `load_bundled` and `identify`; `validate`, `profile` and `bootstrap` say how
far the result can be trusted, `compare` sets it beside the published models. `fitting.records`
turns raw tests into force maps and moduli.
"""

import lazy_loader

__famjax__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
