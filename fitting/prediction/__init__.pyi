from .forces import predict as predict
from .history import hysteresis_error as hysteresis_error, predict_history as predict_history
from .pressures import pressures_for as pressures_for
