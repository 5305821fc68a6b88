from .abstract_peer import PeerModel as PeerModel
from .bolen import Bolen as Bolen
from .braid_alone import ChouHannaford as ChouHannaford, Gaylord as Gaylord
from .empirical import (
    Hildebrandt as Hildebrandt,
    PolynomialSurface as PolynomialSurface,
    Wickramatunge as Wickramatunge,
)
from .force_balance import (
    Kothera as Kothera,
    ferraresi as ferraresi,
    hocking_wereley as hocking_wereley,
    klute_hannaford as klute_hannaford,
    robinson as robinson,
)
from .hunt import Hunt as Hunt
from .martens import Martens as Martens
from .sarosi import Sarosi as Sarosi
from .tondu_lopez import Kerscher as Kerscher, TonduLopez as TonduLopez
