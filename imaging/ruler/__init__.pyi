from .calibrate import calibrate_ruler as calibrate_ruler
from .scale import RulerReading as RulerReading, Scale as Scale
