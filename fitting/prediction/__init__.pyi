from .forces import (
    model_forces as model_forces,
    predict as predict,
    static_rows as static_rows,
)
from .history import hysteresis_error as hysteresis_error, predict_history as predict_history
from .pressures import pressures_for as pressures_for
