"""Long work on one process, on many, or on a cluster: the same call and the same numbers.

`run_tasks` gives items to a function, on whatever engine it is given; `Store` keeps what is
finished. No JAX and no physics.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
