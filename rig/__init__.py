"""Microcontroller to record of a test: protocol, link, journal, plan, simulation.

Start with `read_plan` and `Rig`: pressure control that vents on every way out. `read_journal` reads
a record back, `audit` checks it; `rig.simulation` is a rig without hardware. The firmware, wiring
and safety rules are in `rig/firmware/README.md`.
"""

from famjax.boundary.public_names import attach_rooms

__famjax__ = "0.1.0"

_MOVED = {
    "fitting.records": (
        "Alignment", "Characterisation", "Gap", "Isobar", "IsobaricRecord", "MachineLog", "Stroke",
        "ClockMap", "align_by_load", "align_by_pulses", "characterise", "combine", "dataset_text",
        "fit_clock", "force_rmse", "read_machine_log", "strokes", "write_dataset",
    ),
    "famjax.chain.journals": (
        "UNIT_OF", "clocks", "convert", "table", "to_xarray", "write_netcdf", "write_parquet",
    ),
    "famjax.chain": ("Analysis", "analyse", "figures", "plot_characterisation", "table_rows"),
}  # fmt: skip

__getattr__, __dir__, __all__ = attach_rooms(__name__, __file__, _MOVED)
