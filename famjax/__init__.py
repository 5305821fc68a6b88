"""Fluidic artificial muscles as pure JAX functions: geometry, strain, stress, force.

Values are SI unless a caller keeps another consistent set. The library never changes JAX's
configuration; float64 is the caller's choice (`jax.config.update("jax_enable_x64", True)`).
"""

from . import units as units
from ._bladder import (
    Bladder as Bladder,
    bladder_thickness as bladder_thickness,
    cylinder_volume as cylinder_volume,
    tube_volume as tube_volume,
)
from ._braid import (
    NEUTRAL_ANGLE as NEUTRAL_ANGLE,
    Braid as Braid,
    braid_angle_from_diameter as braid_angle_from_diameter,
    braid_angle_from_length as braid_angle_from_length,
    diameter_from_length as diameter_from_length,
    length_from_diameter as length_from_diameter,
    thread_length_from_angle as thread_length_from_angle,
    turns_from_angle as turns_from_angle,
)
from ._force import (
    bladder_axial_force as bladder_axial_force,
    bladder_hoop_force as bladder_hoop_force,
    force_magnification as force_magnification,
    gaylord_force as gaylord_force,
)
from ._geometry import (
    AbstractGeometry as AbstractGeometry,
    Dimensions as Dimensions,
    EstimatedGeometry as EstimatedGeometry,
)
from ._material import (
    AbstractMaterial as AbstractMaterial,
    PolynomialMaterial as PolynomialMaterial,
    PressurePolynomialMaterial as PressurePolynomialMaterial,
    odd_powers as odd_powers,
)
from ._muscle import Muscle as Muscle
from ._require import require as require
from ._stability import path_modulus as path_modulus

__version__ = "0.1.0"
