from . import (
    app as app,
    boundary as boundary,
    braids as braids,
    cards as cards,
    compile_options as compile_options,
    control as control,
    design as design,
    export as export,
    geometries as geometries,
    materials as materials,
    muscle as muscle,
    muscles as muscles,
    parameters as parameters,
    peers as peers,
    profiles as profiles,
    terms as terms,
    units as units,
)
from ._require import require as require
from ._types import Real as Real
from .braids.elastic import ElasticBraid as ElasticBraid
from .braids.inextensible import Braid as Braid
from .geometries.bladder import Bladder as Bladder
from .geometries.estimated import EstimatedGeometry as EstimatedGeometry
from .geometries.measured import MeasuredGeometry as MeasuredGeometry
from .materials.polynomial import PolynomialMaterial as PolynomialMaterial
from .materials.stability import path_modulus as path_modulus
from .muscle.abstract_muscle import AbstractMuscle as AbstractMuscle
from .muscle.balance import Muscle as Muscle
from .muscle.cutting import cut_to_length as cut_to_length
from .muscle.mounted import MountedMuscle as MountedMuscle
from .muscle.safe import SafeMuscle as SafeMuscle
from .parameters.apart import take_apart as take_apart
from .parameters.declared import parameter as parameter

__version__: str
