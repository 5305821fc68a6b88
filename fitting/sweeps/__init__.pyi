from .all_forms import Sweep as Sweep, SweepRow as SweepRow, sweep as sweep
from .sweep_files import sweep_command as sweep_command
