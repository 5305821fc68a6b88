"""Export muscles to C, FMU, tables, Python, MATLAB and Simulink, MuJoCo and MJX."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
