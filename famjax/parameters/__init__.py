"""Numbers that say what they are: unit, range and scale, declared where the number stands.

A class declares a number with `parameter` (it can be identified) or `number` (it has a unit, and no
force tells it). From the declarations follow the table of parameters of a muscle (`declared`), its
values (`parameters`), a muscle with other values (`with_parameters`), and the flat vector of free,
scaled, bounded parameters that any solver takes (`take_apart`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
