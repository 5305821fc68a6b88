from .all_forms import (
    Sweep as Sweep,
    SweepRow as SweepRow,
    check_options as check_options,
    sweep as sweep,
)
from .sweep_files import sweep_command as sweep_command
