"""Stress laws of the bladder, and their stability along the path that a muscle takes.

A law is a class with one method, `stresses`; `docs/own-models.md` shows one. `path_modulus` gives
Drucker's modulus along the actuation path.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
