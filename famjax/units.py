"""Conversion factors to SI: `100 * units.PSI` is a pressure in Pa, `force / units.LBF` a force in lbf.

All values are exact by definition of the units (NIST SP 811, 2008, appendix B).
"""

import math

INCH = 0.0254
"""Length [m]."""
MILLIMETRE = 1e-3
"""Length [m]."""
LBF = 4.4482216152605
"""Force [N]: one pound under standard gravity, 0.45359237 kg x 9.80665 m/s2."""
PSI = LBF / INCH**2
"""Pressure or stress [Pa]."""
KILOPASCAL = 1e3
"""Pressure [Pa]."""
BAR = 1e5
"""Pressure [Pa]."""
MEGAPASCAL = 1e6
"""Pressure or stress [Pa]."""
DEGREE = math.pi / 180
"""Angle [rad]."""
