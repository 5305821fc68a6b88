from . import (
    bands as bands,
    choice as choice,
    comparison as comparison,
    convex as convex,
    data as data,
    engine as engine,
    evidence as evidence,
    families as families,
    plant as plant,
    posterior as posterior,
    prediction as prediction,
    records as records,
    report as report,
    result as result,
    saved as saved,
    series as series,
    shapes as shapes,
    specimen as specimen,
    sweeps as sweeps,
    validation as validation,
    verdict as verdict,
)
from .choice import Choice as Choice, choose as choose, validate_choice as validate_choice
from .comparison import compare as compare
from .data import (
    ForceData as ForceData,
    bundled_names as bundled_names,
    load_bundled as load_bundled,
    read_csv as read_csv,
    write_csv as write_csv,
)
from .errors import InputError as InputError
from .identification import identify as identify, identify_together as identify_together
from .parameters import Parameter as Parameter
from .plant import PlantRecord as PlantRecord, identify_plant as identify_plant
from .posterior import sample as sample
from .prediction import predict as predict
from .report import (
    plot_fit as plot_fit,
    plot_isobars as plot_isobars,
    write_fit as write_fit,
)
from .result import Identification as Identification
from .saved import load_fit as load_fit
from .series import identify_series as identify_series
from .shapes import shape_surface as shape_surface
from .specimen import Specimen as Specimen
from .sweeps import sweep as sweep
from .validation import bootstrap as bootstrap, profile as profile, validate as validate

__famjax__: str
