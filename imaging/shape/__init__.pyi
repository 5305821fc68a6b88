from .measurement import (
    Measurement as Measurement,
    MeasurementErrors as MeasurementErrors,
    Trace as Trace,
)
from .one_picture import measure as measure
from .overlay import draw_overlay as draw_overlay
from .recipe_file import read_recipe as read_recipe, write_recipe as write_recipe
