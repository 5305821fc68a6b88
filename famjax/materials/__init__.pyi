from .hyperelastic import (
    AbstractHyperelastic as AbstractHyperelastic,
    AbstractUniaxialLaw as AbstractUniaxialLaw,
    MooneyRivlinMaterial as MooneyRivlinMaterial,
    NeoHookeanMaterial as NeoHookeanMaterial,
    OgdenMaterial as OgdenMaterial,
    SaturatingMaterial as SaturatingMaterial,
    YeohMaterial as YeohMaterial,
)
from .monotone import MonotoneMaterial as MonotoneMaterial
from .plain_power import PlainPowerMaterial as PlainPowerMaterial
from .polynomial import (
    AbstractMaterial as AbstractMaterial,
    PolynomialMaterial as PolynomialMaterial,
    PressurePolynomialMaterial as PressurePolynomialMaterial,
    odd_powers as odd_powers,
    tangent_modulus as tangent_modulus,
)
from .stability import (
    PathStrains as PathStrains,
    path_modulus as path_modulus,
    path_strains as path_strains,
)
