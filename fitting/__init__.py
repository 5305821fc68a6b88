"""Identification of fluidic artificial muscles: data with units in, a certified model out."""

import importlib
from typing import Any

from ._data.csv import (
    bundled_names as bundled_names,
    load_bundled as load_bundled,
    read_csv as read_csv,
)
from ._data.force_data import ForceData as ForceData, Specimen as Specimen
from ._data.write_csv import write_csv as write_csv
from ._errors import InputError as InputError
from ._evidence.bootstrap import Bootstrap as Bootstrap, bootstrap as bootstrap
from ._evidence.evidence import Evidence as Evidence
from ._evidence.likelihood import Profile as Profile, profile as profile
from ._evidence.series import (
    SERIES_LAWS as SERIES_LAWS,
    Series as Series,
    identify_series as identify_series,
)
from ._evidence.validation import Validation as Validation, validate as validate
from ._model.geometry_source import (
    AbstractGeometrySource as AbstractGeometrySource,
    EstimatedSource as EstimatedSource,
    KnownSource as KnownSource,
)
from ._model.laws import (
    LAWS as LAWS,
    AbstractLaw as AbstractLaw,
    MonotoneLaw as MonotoneLaw,
    MooneyRivlinLaw as MooneyRivlinLaw,
    OgdenLaw as OgdenLaw,
    PolynomialLaw as PolynomialLaw,
    SaturatingLaw as SaturatingLaw,
)
from ._model.parameters import Parameter as Parameter
from ._peers.compare import (
    Comparison as Comparison,
    comparable_models as comparable_models,
    compare as compare,
)
from ._peers.cross_validation import (
    CrossValidation as CrossValidation,
    GroupError as GroupError,
    cross_validate as cross_validate,
)
from ._peers.families import peer_families as peer_families
from ._peers.family import PeerFamily as PeerFamily, PeerParameter as PeerParameter
from ._peers.fit import (
    PeerFit as PeerFit,
    cross_validate_peer as cross_validate_peer,
    fit_peer as fit_peer,
)
from ._peers.hocking import fit_hocking_wereley as fit_hocking_wereley
from ._peers.row import ComparisonRow as ComparisonRow
from ._ramps.quasi_static import QuasiStatic as QuasiStatic, quasi_static as quasi_static
from ._ramps.record import RampRecord as RampRecord, read_ramp as read_ramp
from ._ramps.static_map import (
    LengthSummary as LengthSummary,
    StaticMap as StaticMap,
    static_map as static_map,
)
from ._rubber.cyclic_record import CyclicRecord as CyclicRecord
from ._rubber.hysteresis import (
    FrictionFit as FrictionFit,
    fit_pressure_friction as fit_pressure_friction,
    fit_thread_friction as fit_thread_friction,
)
from ._rubber.hysteresis_loop import (
    HysteresisLoop as HysteresisLoop,
    hysteresis_loop as hysteresis_loop,
)
from ._rubber.in_situ import (
    InSitu as InSitu,
    ModulusFit as ModulusFit,
    thread_in_situ as thread_in_situ,
)
from ._rubber.tensile import (
    Characterisation as Characterisation,
    TensileFit as TensileFit,
    characterise_bladder as characterise_bladder,
)
from ._rubber.tensile_cycle import TensileCycle as TensileCycle
from ._rubber.tensile_record import TensileRecord as TensileRecord
from ._rubber.thread_fit import ThreadFit as ThreadFit, fit_thread as fit_thread
from ._saved.fit_file import (
    SavedFit as SavedFit,
    fit_as_dict as fit_as_dict,
    load_fit as load_fit,
    series_as_dict as series_as_dict,
    summary_as_dict as summary_as_dict,
)
from ._saved.muscle_card import (
    muscle_as_dict as muscle_as_dict,
    muscle_from_dict as muscle_from_dict,
)
from ._saved.predict import predict as predict
from ._search.identify import identify as identify, identify_together as identify_together
from ._search.result import (
    Certificate as Certificate,
    Errors as Errors,
    Estimate as Estimate,
    Identification as Identification,
)
from ._sweep.sweep import Sweep as Sweep, SweepRow as SweepRow, sweep as sweep
from .engine.qp import Optimum as Optimum, Status as Status, solve_qp as solve_qp

__famjax__ = "0.1.0"

_NEED_MATPLOTLIB = {
    "plot_fit": "_saved.plot",
    "html_report": "_saved.report",
    "write_fit": "_saved.report",
    "plot_ramps": "_ramps.plot",
    "plot_comparison": "_peers.plot",
}


def __getattr__(name: str) -> Any:
    """Load plots and reports, and with them matplotlib, only when they are used."""
    if name in _NEED_MATPLOTLIB:
        return getattr(importlib.import_module(f".{_NEED_MATPLOTLIB[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
