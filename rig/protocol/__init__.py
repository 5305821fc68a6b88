"""What host and device exchange: lines with a CRC, messages, and the control law in integers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
