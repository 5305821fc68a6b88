from .branch_pairs import BranchPairs as BranchPairs
from .history_file import History as History, read_history as read_history
from .left_out import leave_out as leave_out
from .slip_columns import threshold_grid as threshold_grid
from .slip_fit import (
    HysteresisFit as HysteresisFit,
    HysteresisLeftOut as HysteresisLeftOut,
    fit_hysteresis as fit_hysteresis,
)
from .slip_report import (
    hysteresis_as_dict as hysteresis_as_dict,
    hysteresis_table as hysteresis_table,
    hysteresis_warnings as hysteresis_warnings,
)
