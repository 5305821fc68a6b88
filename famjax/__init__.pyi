from . import (
    app as app,
    boundary as boundary,
    braids as braids,
    cards as cards,
    compile_options as compile_options,
    continuation as continuation,
    control as control,
    design as design,
    equilibrium as equilibrium,
    export as export,
    geometries as geometries,
    materials as materials,
    measured as measured,
    muscle as muscle,
    muscles as muscles,
    parameters as parameters,
    peers as peers,
    plant as plant,
    profiles as profiles,
    slip as slip,
    stability as stability,
    surfaces as surfaces,
    terms as terms,
    units as units,
    work as work,
)
from ._arrays import Real as Real
from .braids import Braid as Braid, ElasticBraid as ElasticBraid
from .continuation import SafeMuscle as SafeMuscle
from .equilibrium import EquilibriumMuscle as EquilibriumMuscle
from .geometries import Bladder as Bladder, EstimatedGeometry as EstimatedGeometry
from .materials import PolynomialMaterial as PolynomialMaterial
from .measured import MeasuredGeometry as MeasuredGeometry
from .muscle import (
    AbstractMuscle as AbstractMuscle,
    MountedMuscle as MountedMuscle,
    Muscle as Muscle,
    cut_to_length as cut_to_length,
)
from .parameters import parameter as parameter, take_apart as take_apart
from .stability import path_modulus as path_modulus
from .work import work_budget as work_budget

__version__: str
