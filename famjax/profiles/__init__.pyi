from .assumed_shapes import (
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
from .family import (
    AbstractMeasuredFamily as AbstractMeasuredFamily,
    AbstractProfileFamily as AbstractProfileFamily,
    AssumedShapeFamily as AssumedShapeFamily,
    IsobaricProfile as IsobaricProfile,
    MeasuredFamily as MeasuredFamily,
)
from .profile import AbstractProfile as AbstractProfile, FourierProfile as FourierProfile
from .sampled_surface import SampledSurface as SampledSurface
