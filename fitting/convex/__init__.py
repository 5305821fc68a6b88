"""Convex fits with a certificate: programmes, objectives, constraints along paths.

Written for NumPy's arrays or JAX's, with a leading axis of fits; `solve_qp` is the programme alone.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
