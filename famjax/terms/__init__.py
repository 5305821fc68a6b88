"""Force terms: what a muscle's pull is the sum of. A new one is a class with one method, `force`.

>>> import famjax
>>> terms = famjax.PressurisedBraid(40e3) + famjax.BladderWall(famjax.NeoHookeanMaterial(3e5))
>>> [type(term).__name__ for term in terms.terms]
['PressurisedBraid', 'BladderWall']
"""

from .abstract import AbstractForceTerm as AbstractForceTerm, SumOfTerms as SumOfTerms
from .pressurised import PressurisedBraid as PressurisedBraid, VirtualWork as VirtualWork
from .sliding import Friction as Friction
from .spring import Spring as Spring
from .wall import (
    BladderAxial as BladderAxial,
    BladderHoop as BladderHoop,
    BladderWall as BladderWall,
)
