from .calibrate import calibrate_ruler as calibrate_ruler
from .marks import marks_of as marks_of, numbered as numbered
from .scale import RulerReading as RulerReading, Scale as Scale
