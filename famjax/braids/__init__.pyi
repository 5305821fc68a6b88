from .compliant import CompliantBraid as CompliantBraid
from .elastic import (
    BraidState as BraidState,
    BraidStretch as BraidStretch,
    ElasticBraid as ElasticBraid,
)
from .gaylord import (
    braid_angle_from_blocked_force as braid_angle_from_blocked_force,
    force_magnification as force_magnification,
    gaylord_force as gaylord_force,
)
from .inextensible import (
    NEUTRAL_ANGLE as NEUTRAL_ANGLE,
    AbstractBraid as AbstractBraid,
    Braid as Braid,
    braid_angle_from_diameter as braid_angle_from_diameter,
    braid_angle_from_length as braid_angle_from_length,
    diameter_from_length as diameter_from_length,
    length_from_diameter as length_from_diameter,
    thread_length_from_angle as thread_length_from_angle,
    turns_from_angle as turns_from_angle,
)
from .thread import (
    AbstractThread as AbstractThread,
    LinearThread as LinearThread,
    ToeThread as ToeThread,
    thread_tension as thread_tension,
)
