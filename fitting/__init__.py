"""Identification of fluidic artificial muscles: data with units in, a certified model out."""

import importlib
from typing import Any

from ._csv import (
    bundled_names as bundled_names,
    load_bundled as load_bundled,
    read_csv as read_csv,
)
from ._data import ForceData as ForceData, Specimen as Specimen
from ._errors import InputError as InputError
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
from ._hysteresis import (
    CyclicRecord as CyclicRecord,
    FrictionFit as FrictionFit,
    HysteresisLoop as HysteresisLoop,
    fit_pressure_friction as fit_pressure_friction,
    fit_thread_friction as fit_thread_friction,
    hysteresis_loop as hysteresis_loop,
)
from ._identify import identify as identify
from ._in_situ import (
    InSitu as InSitu,
    ModulusFit as ModulusFit,
    thread_in_situ as thread_in_situ,
)
from ._muscle_card import muscle_as_dict as muscle_as_dict, muscle_from_dict as muscle_from_dict
from ._parameters import Bounds as Bounds, default_bounds as default_bounds
from ._problem import Problem as Problem, build_problem as build_problem
from ._qp import Optimum as Optimum, Status as Status, solve_qp as solve_qp
from ._result import (
    Certificate as Certificate,
    Errors as Errors,
    Estimate as Estimate,
    Identification as Identification,
)
from ._tensile import (
    Characterisation as Characterisation,
    TensileCycle as TensileCycle,
    TensileFit as TensileFit,
    TensileRecord as TensileRecord,
    characterise_bladder as characterise_bladder,
)
from ._thread_fit import ThreadFit as ThreadFit, fit_thread as fit_thread

__famjax__ = "0.1.0"

_NEED_MATPLOTLIB = {"plot_fit": "_plot", "html_report": "_report", "write_fit": "_report"}


def __getattr__(name: str) -> Any:
    """Load plots and reports, and with them matplotlib, only when they are used."""
    if name in _NEED_MATPLOTLIB:
        return getattr(importlib.import_module(f".{_NEED_MATPLOTLIB[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
