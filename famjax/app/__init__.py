"""The command line, and work that joins the packages: tests, photographs and fits of one muscle.

The only package that imports all others.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
