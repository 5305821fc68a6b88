"""Whatever has a force: the muscle, what a rig measures of it, and the base of every other model."""

from .abstract_muscle import AbstractMuscle as AbstractMuscle
from .balance import Muscle as Muscle
from .mounted import MountedMuscle as MountedMuscle
