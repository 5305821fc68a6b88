"""Fits on the disk: `write_fit`, `load_fit`, the report and its picture; the card of a fit."""

from famjax.boundary.public_names import attach_rooms

_MOVED = {
    "fitting.prediction": ("hysteresis_error", "predict", "predict_history", "pressures_for"),
}

__getattr__, __dir__, __all__ = attach_rooms(__name__, __file__, _MOVED)
