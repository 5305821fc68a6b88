from .antagonist import (
    Antagonist as Antagonist,
    JointEquilibrium as JointEquilibrium,
    PairPressures as PairPressures,
    Range as Range,
)
from .inverse import (
    HasForce as HasForce,
    InversePressure as InversePressure,
    pressure_for_force as pressure_for_force,
)
from .outcome import Outcome as Outcome
from .paths import AbstractPath as AbstractPath, Lever as Lever, Pulley as Pulley
