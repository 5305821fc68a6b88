from . import (
    choice as choice,
    comparison as comparison,
    convex as convex,
    data as data,
    engine as engine,
    evidence as evidence,
    families as families,
    posterior as posterior,
    prediction as prediction,
    records as records,
    result as result,
    saved as saved,
    shapes as shapes,
    sweeps as sweeps,
    verdict as verdict,
)
from .choice import Choice as Choice, choose as choose
from .comparison.league_table import compare as compare
from .data.csv_writer import write_csv as write_csv
from .data.force_csv import (
    bundled_names as bundled_names,
    load_bundled as load_bundled,
    read_csv as read_csv,
)
from .data.force_data import ForceData as ForceData, Specimen as Specimen
from .errors import InputError as InputError
from .evidence.likelihood import profile as profile
from .evidence.resampling import bootstrap as bootstrap
from .evidence.validation import validate as validate
from .identification import identify as identify, identify_together as identify_together
from .nested import validate_choice as validate_choice
from .parameters import Parameter as Parameter
from .posterior.sampling import sample as sample
from .prediction.forces import predict as predict
from .result import Identification as Identification
from .saved.fit_plot import (
    plot_fit as plot_fit,
    plot_isobars as plot_isobars,
    plot_law as plot_law,
    plot_residuals as plot_residuals,
)
from .saved.report import write_fit as write_fit
from .saved.saved_fit import load_fit as load_fit
from .series import identify_series as identify_series
from .shapes import shape_surface as shape_surface
from .sweeps.all_forms import sweep as sweep

__famjax__: str
