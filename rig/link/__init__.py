"""The connection to a device: serial port, sessions, commands that are repeated until answered."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
