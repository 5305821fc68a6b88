"""Identification of fluidic artificial muscles: data with units in, a certified model out."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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
        WrappedSource as WrappedSource,
    )
    from ._model.laws import (
        Law as Law,
        known_laws as known_laws,
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
    from ._peers.plot import plot_comparison as plot_comparison
    from ._peers.row import ComparisonRow as ComparisonRow
    from ._ramps.plot import plot_ramps as plot_ramps
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
        fit_as_dict as fit_as_dict,
        series_as_dict as series_as_dict,
        summary_as_dict as summary_as_dict,
    )
    from ._saved.plot import plot_fit as plot_fit
    from ._saved.predict import predict as predict
    from ._saved.report import html_report as html_report, write_fit as write_fit
    from ._saved.saved_fit import SavedFit as SavedFit, load_fit as load_fit
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

_NAMES = {
    "engine.qp": ("Optimum", "Status", "solve_qp"),
    "_data.csv": ("bundled_names", "load_bundled", "read_csv"),
    "_data.force_data": ("ForceData", "Specimen"),
    "_data.write_csv": ("write_csv",),
    "_errors": ("InputError",),
    "_evidence.bootstrap": ("Bootstrap", "bootstrap"),
    "_evidence.evidence": ("Evidence",),
    "_evidence.likelihood": ("Profile", "profile"),
    "_evidence.series": ("SERIES_LAWS", "Series", "identify_series"),
    "_evidence.validation": ("Validation", "validate"),
    "_model.geometry_source": (
        "AbstractGeometrySource",
        "EstimatedSource",
        "KnownSource",
        "WrappedSource",
    ),
    "_model.laws": (
        "Law",
        "known_laws",
    ),
    "_model.parameters": ("Parameter",),
    "_peers.compare": ("Comparison", "comparable_models", "compare"),
    "_peers.cross_validation": ("CrossValidation", "GroupError", "cross_validate"),
    "_peers.families": ("peer_families",),
    "_peers.family": ("PeerFamily", "PeerParameter"),
    "_peers.fit": ("PeerFit", "cross_validate_peer", "fit_peer"),
    "_peers.hocking": ("fit_hocking_wereley",),
    "_peers.plot": ("plot_comparison",),
    "_peers.row": ("ComparisonRow",),
    "_ramps.plot": ("plot_ramps",),
    "_ramps.quasi_static": ("QuasiStatic", "quasi_static"),
    "_ramps.record": ("RampRecord", "read_ramp"),
    "_ramps.static_map": ("LengthSummary", "StaticMap", "static_map"),
    "_rubber.cyclic_record": ("CyclicRecord",),
    "_rubber.hysteresis": ("FrictionFit", "fit_pressure_friction", "fit_thread_friction"),
    "_rubber.hysteresis_loop": ("HysteresisLoop", "hysteresis_loop"),
    "_rubber.in_situ": ("InSitu", "ModulusFit", "thread_in_situ"),
    "_rubber.tensile": ("Characterisation", "TensileFit", "characterise_bladder"),
    "_rubber.tensile_cycle": ("TensileCycle",),
    "_rubber.tensile_record": ("TensileRecord",),
    "_rubber.thread_fit": ("ThreadFit", "fit_thread"),
    "_saved.fit_file": ("fit_as_dict", "series_as_dict", "summary_as_dict"),
    "_saved.plot": ("plot_fit",),
    "_saved.predict": ("predict",),
    "_saved.report": ("html_report", "write_fit"),
    "_saved.saved_fit": ("SavedFit", "load_fit"),
    "_search.identify": ("identify", "identify_together"),
    "_search.result": ("Certificate", "Errors", "Estimate", "Identification"),
    "_sweep.sweep": ("Sweep", "SweepRow", "sweep"),
}
"""The public names of each module; a module is imported when one of its names is first used."""
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

if not TYPE_CHECKING:
    __all__ = list(_MODULE_OF)


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first used: importing the package costs nothing."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_MODULE_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})
