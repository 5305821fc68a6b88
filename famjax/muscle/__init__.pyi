from .abstract_muscle import AbstractMuscle as AbstractMuscle
from .balance import Muscle as Muscle
from .cutting import cut_to_length as cut_to_length
from .mounted import MountedMuscle as MountedMuscle
