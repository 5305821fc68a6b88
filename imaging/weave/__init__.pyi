from .angle import (
    BraidAngle as BraidAngle,
    braid_angle as braid_angle,
    triangle_angle as triangle_angle,
    yarn_lines as yarn_lines,
)
from .directions import Directions as Directions, directions as directions
from .front import Unrolled as Unrolled, unrolled as unrolled
