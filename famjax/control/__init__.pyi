from .air_line import (
    AirLine as AirLine,
    LinePressure as LinePressure,
    Passage as Passage,
    Volume as Volume,
)
from .antagonist import (
    Antagonist as Antagonist,
    JointEquilibrium as JointEquilibrium,
    PairPressures as PairPressures,
    Range as Range,
)
from .feed_forward import (
    CommandedPressure as CommandedPressure,
    FollowedLength as FollowedLength,
    HasMemory as HasMemory,
    length_along as length_along,
    pressure_along as pressure_along,
)
from .gas_volume import (
    HeldLength as HeldLength,
    HeldLoad as HeldLoad,
    fluid_volume as fluid_volume,
)
from .inverse import (
    HasForce as HasForce,
    InversePressure as InversePressure,
    pressure_for_force as pressure_for_force,
)
from .outcome import Answer as Answer, Outcome as Outcome
from .paths import AbstractPath as AbstractPath, Lever as Lever, Pulley as Pulley
