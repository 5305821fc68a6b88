"""Photographs of a muscle to its shape D(z), each figure with its error.

Pictures: u to the right, v downwards, in px, pixel centres at the integers. World: metres, the
camera at the origin, X to the right, Y downwards, Z away from the camera. `z` runs along the
muscle from the upper tape's edge; the length L is that between the inner edges of the two tapes.
Start with `measure` (one picture) or `process` (many); `imaging.synthetic` renders pictures whose
truth is known.
"""

from famjax.boundary.public_names import attach_rooms

__famjax__ = "0.1.0"

_MOVED = {
    "famjax.chain": (
        "StrokeLog", "Tile", "contact_sheet", "expand", "plot_table", "stroke_log",
        "write_check_pictures",
    ),
    "famjax.chain.check_pictures": ("choose",),
    "fitting.shapes": ("FourierFit", "fit_fourier"),
    "fitting.records": (
        "MachineLog", "SyncError", "Synchronisation", "read_machine_log", "synchronise",
    ),
}  # fmt: skip

__getattr__, __dir__, __all__ = attach_rooms(__name__, __file__, _MOVED)
