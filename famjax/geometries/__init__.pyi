from .bladder import (
    Bladder as Bladder,
    bladder_thickness as bladder_thickness,
    cylinder_volume as cylinder_volume,
    tube_volume as tube_volume,
)
from .dimensions import AbstractGeometry as AbstractGeometry, Dimensions as Dimensions
from .end_effect import EndEffectGeometry as EndEffectGeometry
from .estimated import EstimatedGeometry as EstimatedGeometry
from .measured import (
    AverageDiameterGeometry as AverageDiameterGeometry,
    MeasuredGeometry as MeasuredGeometry,
)
from .meridian import (
    Meridian as Meridian,
    maximum_diameter as maximum_diameter,
    quadrature as quadrature,
)
