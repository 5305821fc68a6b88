"""Convert raw test records to force maps: machine logs, clocks, strokes, ramps, hysteresis.

`read_machine_log` reads the log of a test machine, `align_by_load` aligns its clock with that of
another record of the same load, `combine` merges the two records, and `characterise` computes the
isobars. `read_ramp`, `quasi_static` and `static_map` convert raw isometric ramps to a static force
map; `fit_hysteresis` fits Maxwell-slip elements to both branches of the ramps.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
