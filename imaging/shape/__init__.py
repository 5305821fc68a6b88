"""One picture to the shape D(z) with its errors.

`measure` does it by a `Recipe`; a `Measurement` holds length, diameter, volume and their standard
errors, `Quality` the figures by which to judge them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
