from .abstract_muscle import AbstractMuscle as AbstractMuscle
from .balance import Muscle as Muscle
from .continued import ContinuedMuscle as ContinuedMuscle
from .cutting import cut_to_length as cut_to_length
from .mean import MeanMuscle as MeanMuscle
from .mounted import (
    SEATING_FORCE as SEATING_FORCE,
    MountedMuscle as MountedMuscle,
    give_way as give_way,
)
from .numbers import flatten as flatten, number_names as number_names
from .region import (
    Region as Region,
    grid_slopes as grid_slopes,
    largest_share as largest_share,
    rising as rising,
    rising_region as rising_region,
    slopes as slopes,
)
from .safe import SafeMuscle as SafeMuscle
from .volume import continued_volume as continued_volume
