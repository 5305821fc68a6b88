"""What a muscle card holds of each part of a muscle: its fields, and the unit in each key.

A class that is not here has no card. Adding one is adding one entry; its fields are the arguments
of its constructor.
"""

import dataclasses
from collections.abc import Mapping

import equinox as eqx

import famjax


@dataclasses.dataclass(frozen=True)
class Part:
    """A field that holds a part, written as an object with its own `type`.

    Attributes:
        base: what the part must be.
        untyped: the class of an object without `type`, as famjax-fit/1 first wrote them.
        optional: None is a value too.
        many: a list of parts.
    """

    base: type
    untyped: type | None = None
    optional: bool = False
    many: bool = False


Fields = Mapping[str, str | Part]
"""Name of each field, with the unit that its key ends in, "" for a pure number, or its part."""

_BLADDER = Part(famjax.Bladder, untyped=famjax.Bladder)
_BRAID = Part(famjax.AbstractBraid, untyped=famjax.Braid)
_MEASURED = {"family": Part(famjax.MeasuredFamily), "bladder": _BLADDER, "order": ""}
_THREAD = {"modulus": "Pa", "area": "m2"}
_BRAID_AT_REST = {"rest_thread_length": "m", "turns": "", "thickness": "m"}
_DEADBAND = {"deadband_pressure": "Pa"}
_WALL = {"material": Part(famjax.AbstractMaterial)}
_ENDS = {"middle_diameter": "m", "end_diameter": "m", "end_length": "m"}

PARTS: dict[type[eqx.Module], Fields] = {
    famjax.Muscle: {
        "geometry": Part(famjax.AbstractGeometry),
        "material": Part(famjax.AbstractMaterial),
        "deadband_pressure": "Pa",
    },
    # Geometries.
    famjax.EstimatedGeometry: {"braid": _BRAID, "bladder": _BLADDER},
    famjax.MeasuredGeometry: _MEASURED,
    famjax.AverageDiameterGeometry: _MEASURED,
    famjax.EndEffectGeometry: {"cylinder": Part(famjax.AbstractGeometry), "end_factor": ""},
    famjax.Bladder: {
        "rest_length": "m",
        "rest_diameter": "m",
        "rest_thickness": "m",
        "embedded": "",
    },
    # Braids and their threads.
    famjax.Braid: _BRAID_AT_REST,
    famjax.CompliantBraid: {**_BRAID_AT_REST, "compliance": "per_N"},
    famjax.ElasticBraid: {
        **_BRAID_AT_REST,
        "n_threads": "",
        "thread": Part(famjax.AbstractThread),
    },
    famjax.LinearThread: _THREAD,
    famjax.ToeThread: {**_THREAD, "toe_strain": "", "toe_tension": "N"},
    # Profiles and their families.
    famjax.MeasuredFamily: {
        "lengths": "m",
        "profiles": Part(famjax.AbstractProfile, many=True),
        "reference_pressure": "Pa",
        "braid": _BRAID,
        "margin": "",
    },
    famjax.AssumedShapeFamily: {"braid": _BRAID, "shape": Part(famjax.AbstractAssumedShape)},
    famjax.IsobaricProfile: {"family": Part(famjax.AbstractProfileFamily), "pressure": "Pa"},
    famjax.FourierProfile: {"a0": "m", "a": "m", "b": "m", "w": ""},
    famjax.Cylinder: {"middle_diameter": "m"},
    famjax.SteppedCylinder: _ENDS,
    famjax.ConicFrustumEnds: _ENDS,
    famjax.SemiEllipsoidEnds: _ENDS,
    famjax.CircularArcEnds: {"middle_diameter": "m", "end_diameter": "m"},
    famjax.EllipticToroidEnds: {**_ENDS, "arc_angle": "rad"},
    # Materials.
    famjax.PolynomialMaterial: {"coefficients": "Pa"},
    famjax.PressurePolynomialMaterial: {"node_pressures": "Pa", "node_coefficients": "Pa"},
    famjax.NeoHookeanMaterial: {"shear_modulus": "Pa"},
    famjax.MooneyRivlinMaterial: {"c10": "Pa", "c01": "Pa"},
    famjax.YeohMaterial: {"coefficients": "Pa"},
    famjax.OgdenMaterial: {"moduli": "Pa", "exponents": ""},
    famjax.SaturatingMaterial: {
        "final_modulus": "Pa",
        "saturation_stress": "Pa",
        "strain_scale": "",
    },
    famjax.MonotoneMaterial: {"knots": "", "moduli": "Pa"},
    # Force terms.
    famjax.PressurisedBraid: _DEADBAND,
    famjax.VirtualWork: {**_DEADBAND, "at_thread_length": ""},
    famjax.BladderAxial: _WALL,
    famjax.BladderHoop: _WALL,
    famjax.BladderWall: _WALL,
    famjax.Spring: {"stiffness": "N_per_m", "rest_length": "m", "preload": "N"},
    famjax.Friction: {"law": Part(famjax.AbstractFriction), "direction": ""},
    famjax.ThreadFriction: {"coefficient": "", "rest_area": "m2", "rest_braid_angle": "rad"},
    famjax.PressureFriction: {"constant": "N", "per_pressure": "m2"},
}

MUSCLE_OF_TERMS: Fields = {
    "geometry": Part(famjax.AbstractGeometry),
    "terms": Part(famjax.AbstractForceTerm, many=True),
}
"""A muscle with other terms than a pressurised braid and the wall of one material."""
