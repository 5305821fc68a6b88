"""What a saved fit predicts: the force with its band, where it begins, and the pressure for a force.

`predict` is where to start; `pressures_for` asks the other way round, `predict_history` after a
history of pressures. `inside.py` says how far a fit reaches: what was measured, and what was tried.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
