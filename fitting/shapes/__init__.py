"""From a table of photographs to the shape of a muscle over length and pressure.

`shape_surface(table)` fits D(z; L, P) to the pictures, tests it on pictures held out, and gives the
measured geometry of a muscle with `surface.geometry(specimen)`. `fit_fourier` describes one profile.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
