"""Identification of fluidic artificial muscles: data with units in, a certified model out."""

import importlib
from typing import Any

from ._bootstrap import Bootstrap as Bootstrap, bootstrap as bootstrap
from ._compare import (
    Comparison as Comparison,
    comparable_models as comparable_models,
    compare as compare,
)
from ._comparison_row import ComparisonRow as ComparisonRow
from ._cross_validation import (
    CrossValidation as CrossValidation,
    GroupError as GroupError,
    cross_validate as cross_validate,
)
from ._csv import (
    bundled_names as bundled_names,
    load_bundled as load_bundled,
    read_csv as read_csv,
)
from ._cyclic_record import CyclicRecord as CyclicRecord
from ._data import ForceData as ForceData, Specimen as Specimen
from ._errors import InputError as InputError
from ._evidence import Evidence as Evidence
from ._fit_file import (
    SavedFit as SavedFit,
    fit_as_dict as fit_as_dict,
    load_fit as load_fit,
    summary_as_dict as summary_as_dict,
)
from ._geometry_source import (
    AbstractGeometrySource as AbstractGeometrySource,
    EstimatedSource as EstimatedSource,
    KnownSource as KnownSource,
)
from ._hocking import fit_hocking_wereley as fit_hocking_wereley
from ._hysteresis import (
    FrictionFit as FrictionFit,
    fit_pressure_friction as fit_pressure_friction,
    fit_thread_friction as fit_thread_friction,
)
from ._hysteresis_loop import HysteresisLoop as HysteresisLoop, hysteresis_loop as hysteresis_loop
from ._identify import identify as identify, identify_together as identify_together
from ._in_situ import (
    InSitu as InSitu,
    ModulusFit as ModulusFit,
    thread_in_situ as thread_in_situ,
)
from ._laws import (
    LAWS as LAWS,
    AbstractLaw as AbstractLaw,
    MonotoneLaw as MonotoneLaw,
    MooneyRivlinLaw as MooneyRivlinLaw,
    OgdenLaw as OgdenLaw,
    PolynomialLaw as PolynomialLaw,
    SaturatingLaw as SaturatingLaw,
)
from ._likelihood import Profile as Profile, profile as profile
from ._muscle_card import muscle_as_dict as muscle_as_dict, muscle_from_dict as muscle_from_dict
from ._parameters import Parameter as Parameter
from ._peer_families import peer_families as peer_families
from ._peer_family import PeerFamily as PeerFamily, PeerParameter as PeerParameter
from ._peer_fit import (
    PeerFit as PeerFit,
    cross_validate_peer as cross_validate_peer,
    fit_peer as fit_peer,
)
from ._predict import predict as predict
from ._qp import Optimum as Optimum, Status as Status, solve_qp as solve_qp
from ._quasi_static import QuasiStatic as QuasiStatic, quasi_static as quasi_static
from ._ramp import RampRecord as RampRecord, read_ramp as read_ramp
from ._result import (
    Certificate as Certificate,
    Errors as Errors,
    Estimate as Estimate,
    Identification as Identification,
)
from ._static_map import (
    LengthSummary as LengthSummary,
    StaticMap as StaticMap,
    static_map as static_map,
)
from ._sweep import Sweep as Sweep, SweepRow as SweepRow, sweep as sweep
from ._tensile import (
    Characterisation as Characterisation,
    TensileFit as TensileFit,
    characterise_bladder as characterise_bladder,
)
from ._tensile_cycle import TensileCycle as TensileCycle
from ._tensile_record import TensileRecord as TensileRecord
from ._thread_fit import ThreadFit as ThreadFit, fit_thread as fit_thread
from ._validation import Validation as Validation, validate as validate
from ._write_csv import write_csv as write_csv

__famjax__ = "0.1.0"

_NEED_MATPLOTLIB = {
    "plot_fit": "_plot",
    "html_report": "_report",
    "write_fit": "_report",
    "plot_ramps": "_ramp_plot",
    "plot_comparison": "_compare_plot",
}


def __getattr__(name: str) -> Any:
    """Load plots and reports, and with them matplotlib, only when they are used."""
    if name in _NEED_MATPLOTLIB:
        return getattr(importlib.import_module(f".{_NEED_MATPLOTLIB[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
