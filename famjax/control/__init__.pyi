from .inverse import (
    InversePressure as InversePressure,
    Outcome as Outcome,
    pressure_for_force as pressure_for_force,
)
from .pair import (
    AbstractPath as AbstractPath,
    Antagonist as Antagonist,
    PairPressures as PairPressures,
    Pulley as Pulley,
)
