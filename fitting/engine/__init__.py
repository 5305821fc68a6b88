"""The one fit: a family of models, its program, variable projection on the host and in JAX."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
