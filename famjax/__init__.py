"""Fluidic artificial muscles as pure JAX functions: geometry, strain, stress, force, design.

Values are in SI units unless the caller uses another consistent set. The library never changes JAX's
configuration; float64 is the caller's choice (`jax.config.update("jax_enable_x64", True)`).
Start with `Muscle`, which combines a geometry (`famjax.geometries`) with force terms
(`famjax.terms`) or a bladder law (`famjax.materials`). `famjax.peers` contains models published by
other authors.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
