"""Force terms: what a muscle's pull is the sum of. A new one is a class with one method, `force`.

>>> from famjax.materials import NeoHookeanMaterial
>>> terms = PressurisedBraid(40e3) + BladderWall(NeoHookeanMaterial(3e5))
>>> [type(term).__name__ for term in terms.terms]
['PressurisedBraid', 'BladderWall']
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
