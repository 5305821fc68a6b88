from .balance import (
    Gaylord as Gaylord,
    Kothera as Kothera,
    Martens as Martens,
    PeerModel as PeerModel,
    TonduLopez as TonduLopez,
)
from .empirical import (
    Hildebrandt as Hildebrandt,
    Sarosi as Sarosi,
)
