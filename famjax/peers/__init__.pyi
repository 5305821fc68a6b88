from .balance import (
    Gaylord as Gaylord,
    Kothera as Kothera,
    Martens as Martens,
    PeerModel as PeerModel,
    TonduLopez as TonduLopez,
    ferraresi as ferraresi,
    klute_hannaford as klute_hannaford,
    robinson as robinson,
)
from .empirical import (
    Hildebrandt as Hildebrandt,
    Sarosi as Sarosi,
)
