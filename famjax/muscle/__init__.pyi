from .abstract_muscle import AbstractMuscle as AbstractMuscle
from .balance import Muscle as Muscle
from .continued import ContinuedMuscle as ContinuedMuscle
from .cutting import cut_to_length as cut_to_length
from .mean import MeanMuscle as MeanMuscle
from .mounted import MountedMuscle as MountedMuscle
from .region import Region as Region, rising_region as rising_region
from .safe import SafeMuscle as SafeMuscle
