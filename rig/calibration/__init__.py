"""Calibration of a rig: its sensors, and the output that holds a pressure by itself.

`read_calibration` reads the TOML file of a rig; `fit_sensor` and `fit_feed_forward` make its parts.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
