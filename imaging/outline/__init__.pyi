from .both_sides import Outline as Outline, Side as Side, find_outline as find_outline
from .dents import without_dents as without_dents
from .edge_fit import best_shift as best_shift
from .edge_model import (
    LARGEST_DISK as LARGEST_DISK,
    defocused_step as defocused_step,
    ramp as ramp,
    step as step,
)
from .edge_profile import EdgeProfile as EdgeProfile, limb_strength as limb_strength
from .edge_windows import aligned_windows as aligned_windows
from .midline import axis_deviation as axis_deviation, axis_kink as axis_kink
from .smoother import (
    density_left_over as density_left_over,
    smooth as smooth,
    smooth_robustly as smooth_robustly,
    variance_of_smooth as variance_of_smooth,
)
