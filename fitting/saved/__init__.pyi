from .card import card_of as card_of
from .fit_file import (
    correlations as correlations,
    fit_as_dict as fit_as_dict,
    series_as_dict as series_as_dict,
    summary_as_dict as summary_as_dict,
)
from .fit_plot import plot_fit as plot_fit
from .history import predict_history as predict_history
from .prediction import predict as predict
from .report import (
    html_report as html_report,
    notes as notes,
    tables as tables,
    verdict as verdict,
    write_fit as write_fit,
)
from .saved_fit import SavedFit as SavedFit, load_fit as load_fit
