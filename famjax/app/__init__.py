"""The command line, and code that combines the test data, photographs and fits for one muscle.

This is the only package that imports all the others.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
