from .abstract_material import (
    AbstractMaterial as AbstractMaterial,
    tangent_modulus as tangent_modulus,
)
from .hyperelastic import (
    AbstractHyperelastic as AbstractHyperelastic,
    MooneyRivlinMaterial as MooneyRivlinMaterial,
    NeoHookeanMaterial as NeoHookeanMaterial,
    OgdenMaterial as OgdenMaterial,
    YeohMaterial as YeohMaterial,
)
from .monotone import MonotoneMaterial as MonotoneMaterial
from .plain_power import PlainPowerMaterial as PlainPowerMaterial
from .polynomial import (
    PolynomialMaterial as PolynomialMaterial,
    PressurePolynomialMaterial as PressurePolynomialMaterial,
    odd_powers as odd_powers,
)
from .stability import (
    PathStrains as PathStrains,
    path_modulus as path_modulus,
    path_strains as path_strains,
)
from .uniaxial import (
    AbstractUniaxialLaw as AbstractUniaxialLaw,
    SaturatingMaterial as SaturatingMaterial,
)
