from .all_forms import Sweep as Sweep, SweepRow as SweepRow, sweep as sweep
