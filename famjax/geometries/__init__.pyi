from .bladder import (
    Bladder as Bladder,
    bladder_thickness as bladder_thickness,
    cylinder_volume as cylinder_volume,
    tube_volume as tube_volume,
)
from .braid_limits import braid_limits as braid_limits
from .dimensions import AbstractGeometry as AbstractGeometry, Dimensions as Dimensions
from .end_effect import EndEffectGeometry as EndEffectGeometry
from .estimated import EstimatedGeometry as EstimatedGeometry
from .inner_volume import inner_volume as inner_volume
from .measured import (
    AverageDiameterGeometry as AverageDiameterGeometry,
    MeasuredGeometry as MeasuredGeometry,
)
from .meridian import (
    Meridian as Meridian,
    maximum_diameter as maximum_diameter,
    quadrature as quadrature,
)
