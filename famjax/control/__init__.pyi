from .inverse import (
    Answer as Answer,
    CommandedPressure as CommandedPressure,
    HasForce as HasForce,
    HasMemory as HasMemory,
    InversePressure as InversePressure,
    Outcome as Outcome,
    pressure_along as pressure_along,
    pressure_for_force as pressure_for_force,
)
from .pair import (
    AbstractPath as AbstractPath,
    Antagonist as Antagonist,
    JointEquilibrium as JointEquilibrium,
    Lever as Lever,
    PairPressures as PairPressures,
    Pulley as Pulley,
    Range as Range,
)
