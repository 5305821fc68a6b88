"""Raw tests to force maps: machine logs, clocks, strokes, ramps, hysteresis.

`read_machine_log` reads the log of a test machine, `align_by_load` lays it onto another record of
the same load, `combine` makes one record of both, `characterise` finds the curves of its isobars.
`read_ramp`, `quasi_static` and `static_map` turn raw isometric ramps into a static force map,
`fit_hysteresis` fits both branches by Maxwell-slip elements.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
