"""Static force models of other authors, in SI: to evaluate, to differentiate and to compare with.

Each is a `PeerModel`, or a `famjax.Muscle` where it is one, with `force(length, pressure)`. Every
docstring says whether its form was read or is general knowledge. Braid angles are measured from
the circumference, contraction is a fraction, pressure is gauge.
"""

from ._bolen import Bolen as Bolen
from ._empirical import (
    Hildebrandt as Hildebrandt,
    PolynomialSurface as PolynomialSurface,
    Wickramatunge as Wickramatunge,
)
from ._force_balance import (
    Kothera as Kothera,
    ferraresi as ferraresi,
    hocking_wereley as hocking_wereley,
    klute_hannaford as klute_hannaford,
    robinson as robinson,
)
from ._gaylord import ChouHannaford as ChouHannaford, Gaylord as Gaylord
from ._hunt import Hunt as Hunt
from ._martens import Martens as Martens
from ._model import PeerModel as PeerModel
from ._plain_power import PlainPowerMaterial as PlainPowerMaterial
from ._sarosi import Sarosi as Sarosi
from ._tondu_lopez import Kerscher as Kerscher, TonduLopez as TonduLopez
