"""Photographs of a muscle to its shape D(z), each figure with its error.

Pictures: u to the right, v downwards, in px, pixel centres at the integers. World: metres, the
camera at the origin, X to the right, Y downwards, Z away from the camera. `z` runs along the
muscle from the upper tape's edge; the length L is that between the inner edges of the two tapes.
"""

import importlib
from typing import TYPE_CHECKING, Any

from ._camera import (
    Camera as Camera,
    Silhouette as Silhouette,
    apparent_diameter as apparent_diameter,
    profile_from_silhouette as profile_from_silhouette,
    ring_position as ring_position,
    silhouette_from_profile as silhouette_from_profile,
)
from ._errors import (
    AmbiguousHue as AmbiguousHue,
    AmbiguousRuler as AmbiguousRuler,
    Clipped as Clipped,
    DamagedImage as DamagedImage,
    Defocused as Defocused,
    ExtraFitting as ExtraFitting,
    ImagingError as ImagingError,
    MissingFitting as MissingFitting,
    MixedSizes as MixedSizes,
    MotionBlurred as MotionBlurred,
    NoMuscle as NoMuscle,
    Overexposed as Overexposed,
    RulerNotFound as RulerNotFound,
    ScaleContradiction as ScaleContradiction,
    SyncError as SyncError,
    Underexposed as Underexposed,
    UnreadableImage as UnreadableImage,
    WrongOrientation as WrongOrientation,
)
from ._tone import Tone as Tone

if TYPE_CHECKING:
    from . import synthetic as synthetic
    from ._campaign import process as process
    from ._contact_sheet import Tile as Tile, contact_sheet as contact_sheet
    from ._fourier import FourierFit as FourierFit, fit_fourier as fit_fourier
    from ._machine_log import MachineLog as MachineLog, read_machine_log as read_machine_log
    from ._measure import measure as measure
    from ._measurement import Measurement as Measurement
    from ._overlay import draw_overlay as draw_overlay
    from ._plots import plot_table as plot_table
    from ._quality import Limits as Limits, Quality as Quality
    from ._read import read_image as read_image
    from ._recipe import Recipe as Recipe
    from ._recipe_file import read_recipe as read_recipe, write_recipe as write_recipe
    from ._ruler import calibrate_ruler as calibrate_ruler
    from ._scale import RulerReading as RulerReading, Scale as Scale
    from ._shards import CampaignChanged as CampaignChanged
    from ._sync import Synchronisation as Synchronisation, synchronise as synchronise
    from ._table import Table as Table
    from ._timestamps import Timestamp as Timestamp, read_timestamp as read_timestamp
    from ._workers import WorkerDied as WorkerDied

__famjax__ = "0.1.0"

_LATER = {
    "_campaign": ("process",),
    "_contact_sheet": ("Tile", "contact_sheet"),
    "_fourier": ("FourierFit", "fit_fourier"),
    "_machine_log": ("MachineLog", "read_machine_log"),
    "_measure": ("measure",),
    "_measurement": ("Measurement",),
    "_overlay": ("draw_overlay",),
    "_plots": ("plot_table",),
    "_quality": ("Limits", "Quality"),
    "_read": ("read_image",),
    "_recipe": ("Recipe",),
    "_recipe_file": ("read_recipe", "write_recipe"),
    "_ruler": ("calibrate_ruler",),
    "_scale": ("RulerReading", "Scale"),
    "_shards": ("CampaignChanged",),
    "_sync": ("Synchronisation", "synchronise"),
    "_table": ("Table",),
    "_timestamps": ("Timestamp", "read_timestamp"),
    "_workers": ("WorkerDied",),
}
_MODULE_OF = {name: module for module, names in _LATER.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load what needs OpenCV, pandas or matplotlib, and these with it, only when it is used."""
    if name == "synthetic":
        return importlib.import_module(".synthetic", __name__)
    if name in _MODULE_OF:
        return getattr(importlib.import_module(f".{_MODULE_OF[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF, "synthetic"})
