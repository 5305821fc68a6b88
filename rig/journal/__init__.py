"""The record of a test: written line by line, read back verified, checked against the control law.

`Journal` writes, `read_journal` reads, `audit` checks, `table` gives columns in SI on the host's clock.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
