"""Families of muscles: laws, sources of geometry, the table of parameters with bounds and priors."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
