from .camera import (
    Camera as Camera,
    Scale as Scale,
    Silhouette as Silhouette,
    Tone as Tone,
)
from .campaign import Table as Table, process as process
from .errors import ImagingError as ImagingError
from .measurement import (
    Measurement as Measurement,
    MeasurementErrors as MeasurementErrors,
    draw_overlay as draw_overlay,
    measure as measure,
)
from .photograph import (
    read_image as read_image,
    read_timestamp as read_timestamp,
)
from .recipe import (
    Quality as Quality,
    Recipe as Recipe,
    recipe_text as recipe_text,
    write_recipe as write_recipe,
)
from .ruler import calibrate_ruler as calibrate_ruler
from .weave import BraidAngle as BraidAngle

__famjax__: str
