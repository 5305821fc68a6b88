from .force_map import (
    LengthSummary as LengthSummary,
    StaticMap as StaticMap,
    static_map as static_map,
)
from .quasi_static_ramp import QuasiStatic as QuasiStatic, quasi_static as quasi_static
from .ramp_files import (
    parse_atmosphere as parse_atmosphere,
    ramp_data as ramp_data,
    ramp_specimen as ramp_specimen,
    ramps_command as ramps_command,
    read_ramps as read_ramps,
)
from .ramp_pairs import (
    branches_csv as branches_csv,
    ramp_pairs as ramp_pairs,
    read_branches as read_branches,
)
from .ramp_plot import plot_ramps as plot_ramps
from .record import RampRecord as RampRecord, read_ramp as read_ramp
