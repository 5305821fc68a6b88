from . import (
    camera as camera,
    campaign as campaign,
    errors as errors,
    outline as outline,
    quality as quality,
    recipe as recipe,
    ruler as ruler,
    segment as segment,
    shape as shape,
    synthetic as synthetic,
    tape as tape,
)
from .camera.read import read_image as read_image
from .campaign.run import process as process
from .campaign.table import Table as Table
from .errors import ImagingError as ImagingError
from .recipe import Recipe as Recipe
from .ruler.calibrate import calibrate_ruler as calibrate_ruler
from .ruler.scale import Scale as Scale
from .shape.measurement import Measurement as Measurement
from .shape.one_picture import measure as measure
from .shape.recipe_file import read_recipe as read_recipe

__famjax__: str
