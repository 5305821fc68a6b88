from .all_forms import (
    check_options as check_options,
    sweep as sweep,
)
from .result import Sweep as Sweep, SweepRow as SweepRow
from .sweep_files import sweep_command as sweep_command
