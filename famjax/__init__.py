"""Models of fluidic artificial muscles as pure JAX functions: geometry, stress, force and design.

Values are in SI units unless the caller uses another consistent system of units. The library never
changes JAX's configuration. To compute in float64, call `jax.config.update("jax_enable_x64", True)`.
Start with `Muscle`, which combines a geometry (`famjax.geometries`) with force terms
(`famjax.terms`) or a bladder law (`famjax.materials`). `famjax.peers` contains models published by
other authors.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
