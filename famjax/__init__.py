"""Fluidic artificial muscles as pure JAX functions: geometry, strain, stress, force, design.

Values are SI unless a caller keeps another consistent set. The library never changes JAX's
configuration; float64 is the caller's choice (`jax.config.update("jax_enable_x64", True)`).
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import (
        compile_options as compile_options,
        design as design,
        muscle as muscle,
        parameters as parameters,
        peers as peers,
        terms as terms,
        units as units,
    )
    from ._assumed_shapes import (
        AbstractAssumedShape as AbstractAssumedShape,
        CircularArcEnds as CircularArcEnds,
        ConicFrustumEnds as ConicFrustumEnds,
        Cylinder as Cylinder,
        EllipticToroidEnds as EllipticToroidEnds,
        SemiEllipsoidEnds as SemiEllipsoidEnds,
        SteppedCylinder as SteppedCylinder,
        kothera_length as kothera_length,
        tondu_lopez_length as tondu_lopez_length,
    )
    from ._bladder import (
        Bladder as Bladder,
        bladder_thickness as bladder_thickness,
        cylinder_volume as cylinder_volume,
        tube_volume as tube_volume,
    )
    from ._braid import (
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
    from ._compliant_braid import CompliantBraid as CompliantBraid
    from ._cut_to_length import cut_to_length as cut_to_length
    from ._elastic_braid import (
        BraidState as BraidState,
        BraidStretch as BraidStretch,
        ElasticBraid as ElasticBraid,
    )
    from ._end_effect import EndEffectGeometry as EndEffectGeometry
    from ._force import (
        bladder_axial_force as bladder_axial_force,
        bladder_hoop_force as bladder_hoop_force,
        force_magnification as force_magnification,
        gaylord_force as gaylord_force,
    )
    from ._friction import (
        AbstractFriction as AbstractFriction,
        PressureFriction as PressureFriction,
        ThreadFriction as ThreadFriction,
        crossing_area as crossing_area,
        smooth_sign as smooth_sign,
        thread_contact_area as thread_contact_area,
    )
    from ._geometry import (
        AbstractGeometry as AbstractGeometry,
        Dimensions as Dimensions,
        EstimatedGeometry as EstimatedGeometry,
    )
    from ._hyperelastic import (
        AbstractHyperelastic as AbstractHyperelastic,
        AbstractUniaxialLaw as AbstractUniaxialLaw,
        MooneyRivlinMaterial as MooneyRivlinMaterial,
        NeoHookeanMaterial as NeoHookeanMaterial,
        OgdenMaterial as OgdenMaterial,
        SaturatingMaterial as SaturatingMaterial,
        YeohMaterial as YeohMaterial,
    )
    from ._material import (
        AbstractMaterial as AbstractMaterial,
        PolynomialMaterial as PolynomialMaterial,
        PressurePolynomialMaterial as PressurePolynomialMaterial,
        odd_powers as odd_powers,
        tangent_modulus as tangent_modulus,
    )
    from ._measured_geometry import (
        AverageDiameterGeometry as AverageDiameterGeometry,
        MeasuredGeometry as MeasuredGeometry,
    )
    from ._monotone import MonotoneMaterial as MonotoneMaterial
    from ._profile import AbstractProfile as AbstractProfile, FourierProfile as FourierProfile
    from ._profile_family import (
        AbstractProfileFamily as AbstractProfileFamily,
        AssumedShapeFamily as AssumedShapeFamily,
        IsobaricProfile as IsobaricProfile,
        MeasuredFamily as MeasuredFamily,
    )
    from ._profile_measures import (
        Meridian as Meridian,
        maximum_diameter as maximum_diameter,
        quadrature as quadrature,
    )
    from ._require import require as require
    from ._stability import (
        PathStrains as PathStrains,
        path_modulus as path_modulus,
        path_strains as path_strains,
    )
    from ._thread import (
        AbstractThread as AbstractThread,
        LinearThread as LinearThread,
        ToeThread as ToeThread,
        thread_tension as thread_tension,
    )
    from ._types import Real as Real
    from ._virtual_work import (
        PressureTerms as PressureTerms,
        pressure_terms as pressure_terms,
        virtual_work_force as virtual_work_force,
        volume_rate as volume_rate,
    )
    from .muscle import (
        AbstractMuscle as AbstractMuscle,
        MountedMuscle as MountedMuscle,
        Muscle as Muscle,
    )
    from .parameters import (
        Apart as Apart,
        Declared as Declared,
        Parametrised as Parametrised,
        number as number,
        parameter as parameter,
        take_apart as take_apart,
    )
    from .terms import (
        AbstractForceTerm as AbstractForceTerm,
        BladderAxial as BladderAxial,
        BladderHoop as BladderHoop,
        BladderWall as BladderWall,
        Friction as Friction,
        PressurisedBraid as PressurisedBraid,
        Spring as Spring,
        SumOfTerms as SumOfTerms,
        VirtualWork as VirtualWork,
    )

__version__ = "0.1.0"

_NAMES = {
    "_assumed_shapes": (
        "AbstractAssumedShape",
        "CircularArcEnds",
        "ConicFrustumEnds",
        "Cylinder",
        "EllipticToroidEnds",
        "SemiEllipsoidEnds",
        "SteppedCylinder",
        "kothera_length",
        "tondu_lopez_length",
    ),
    "_bladder": ("Bladder", "bladder_thickness", "cylinder_volume", "tube_volume"),
    "_braid": (
        "NEUTRAL_ANGLE",
        "AbstractBraid",
        "Braid",
        "braid_angle_from_diameter",
        "braid_angle_from_length",
        "diameter_from_length",
        "length_from_diameter",
        "thread_length_from_angle",
        "turns_from_angle",
    ),
    "_compliant_braid": ("CompliantBraid",),
    "_cut_to_length": ("cut_to_length",),
    "_elastic_braid": ("BraidState", "BraidStretch", "ElasticBraid"),
    "_end_effect": ("EndEffectGeometry",),
    "_force": ("bladder_axial_force", "bladder_hoop_force", "force_magnification", "gaylord_force"),
    "_friction": (
        "AbstractFriction",
        "PressureFriction",
        "ThreadFriction",
        "crossing_area",
        "smooth_sign",
        "thread_contact_area",
    ),
    "_geometry": ("AbstractGeometry", "Dimensions", "EstimatedGeometry"),
    "_hyperelastic": (
        "AbstractHyperelastic",
        "AbstractUniaxialLaw",
        "MooneyRivlinMaterial",
        "NeoHookeanMaterial",
        "OgdenMaterial",
        "SaturatingMaterial",
        "YeohMaterial",
    ),
    "_material": (
        "AbstractMaterial",
        "PolynomialMaterial",
        "PressurePolynomialMaterial",
        "odd_powers",
        "tangent_modulus",
    ),
    "_measured_geometry": ("AverageDiameterGeometry", "MeasuredGeometry"),
    "_monotone": ("MonotoneMaterial",),
    "_profile": ("AbstractProfile", "FourierProfile"),
    "_profile_family": (
        "AbstractProfileFamily",
        "AssumedShapeFamily",
        "IsobaricProfile",
        "MeasuredFamily",
    ),
    "_profile_measures": ("Meridian", "maximum_diameter", "quadrature"),
    "_require": ("require",),
    "_stability": ("PathStrains", "path_modulus", "path_strains"),
    "_thread": ("AbstractThread", "LinearThread", "ToeThread", "thread_tension"),
    "_types": ("Real",),
    "_virtual_work": (
        "PressureTerms",
        "pressure_terms",
        "virtual_work_force",
        "volume_rate",
    ),
    "muscle": ("AbstractMuscle", "MountedMuscle", "Muscle"),
    "parameters": ("Apart", "Declared", "Parametrised", "number", "parameter", "take_apart"),
    "terms": (
        "AbstractForceTerm",
        "BladderAxial",
        "BladderHoop",
        "BladderWall",
        "Friction",
        "PressurisedBraid",
        "Spring",
        "SumOfTerms",
        "VirtualWork",
    ),
}
"""The public names of each module; a module is imported when one of its names is first used."""
_NAMESPACES = ("compile_options", "design", "muscle", "parameters", "peers", "terms", "units")
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

if not TYPE_CHECKING:
    __all__ = list(_MODULE_OF) + list(_NAMESPACES)


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first used: importing the package costs nothing."""
    if name in _NAMESPACES:
        return importlib.import_module(f".{name}", __name__)
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_MODULE_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF, *_NAMESPACES})
