"""All that the report is made of, read back from the files of the steps before it."""

import csv
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import fitting
from famjax.boundary.units import factor, unit_system
from fitting.data.force_data import COLUMNS, ForceData
from fitting.saved import SavedFit
from fitting.shapes import Pictures, ShapeSurface

from ..evaluation import (
    CYLINDER,
    GEOMETRIES,
    MEASURED,
    PICTURES,
    RECORDS,
    SHAPE,
    measured_surface,
    read_map,
)
from ..sheet import RESULTS, Sheet
from .states import States, states_of

COLOURS = dict(zip(GEOMETRIES, ("0.35", "0.65", "#e69f00", "#0072b2", "#009e73"), strict=True))
"""Of the geometries in every chart; distinct without red or green as well."""
DASHES = dict(zip(GEOMETRIES, ("--", "--", "-.", "-", ":"), strict=True))
MINUS = "\N{MINUS SIGN}"
_STROKE = 41
"""Lengths over the measured stroke at which the models are asked."""


@dataclasses.dataclass(frozen=True)
class FittedGeometry:
    """One geometry's fit.

    Attributes:
        name: of the geometry, and of its step.
        saved: the fit.
        figures: of the step beside it: errors, values, errors of the shape.
        data: the readings that it was given.
        states: of the model over the stroke and over its whole range.
    """

    name: str
    saved: SavedFit
    figures: dict[str, Any]
    data: ForceData
    states: States

    @property
    def title(self) -> str:
        """What the geometry is."""
        return GEOMETRIES[self.name]

    @property
    def short(self) -> str:
        """The same in a word or two, for legends and headers."""
        return self.name.replace("-", " ")

    @property
    def residuals(self) -> np.ndarray:
        """Model less measured [N] at the loaded readings."""
        return np.array(self.saved.document["residuals_N"])

    @property
    def levels(self) -> np.ndarray:
        """Pressure level [Pa] of the loaded readings."""
        return self.data.pressures.level[self.data.loaded]


@dataclasses.dataclass(frozen=True)
class Source:
    """What lies in the folder and in its results.

    Attributes:
        sheet: of the folder.
        system: of units.
        names: of the steps.
        data: the force map.
        isobars: figures of the test by set pressure; () without its record.
        test: all of `characterisation.json`, or {}.
        fits: by geometry.
        surface: through the photographs, or None.
        pictures: that were measured, or None.
        shape: all of `shape.json`, or None.
        pressures: gauge pressures [Pa] that were held, ascending.
    """

    sheet: Sheet
    system: str
    names: Sequence[str]
    data: ForceData
    isobars: Sequence[dict[str, Any]]
    test: dict[str, Any]
    fits: dict[str, FittedGeometry]
    surface: ShapeSurface | None
    pictures: Pictures | None
    shape: dict[str, Any] | None
    pressures: np.ndarray

    @property
    def results(self) -> Path:
        """The folder of the steps."""
        return self.sheet.folder / RESULTS

    @property
    def steps(self) -> list[Path]:
        """The folder of every step."""
        return [self.results / name for name in self.names]

    @property
    def best(self) -> FittedGeometry:
        """The fit that the report shows: of the measured shape, where there is one."""
        return self.fits[MEASURED if MEASURED in self.fits else CYLINDER]

    @property
    def middle(self) -> int:
        """Number of the pressure at which what depends on contraction is shown."""
        return len(self.pressures) // 2

    def unit(self, kind: str) -> str:
        """Of the report, for a kind of quantity; a muscle's volume is shown in cm3, not mm3."""
        unit = unit_system(self.system)[kind]
        return "cm3" if unit == "mm3" else unit

    def scaled(self, value: Any, kind: str) -> Any:
        """An SI value or array in the report's unit."""
        return value / factor(self.unit(kind), kind)

    def number(self, value: float | None, kind: str = "number", digits: int = 4) -> str:
        """A number of the page; a dash for what is not known."""
        if value is None or not np.isfinite(value):
            return "\N{EN DASH}"
        return f"{self.scaled(float(value), kind):.{digits}g}".replace("-", MINUS)

    def pressure(self, value: float) -> str:
        """A pressure with its unit."""
        return f"{self.number(value, 'pressure', 3)} {self.unit('pressure')}"


def read_source(sheet: Sheet, names: Sequence[str], system: str) -> Source:
    """Everything for the report; the models are asked once each, for all of it."""
    results = sheet.folder / RESULTS
    data = read_map(sheet)
    record = results / RECORDS / "characterisation.json"
    test = _read(record) if record.exists() else {}
    isobars = test.get("isobars", [])
    pressures = (
        np.array([bar["pressure_Pa"] for bar in isobars])
        if isobars
        else np.unique(data.pressures.level[data.loaded])
    )
    shortest = float(data.length.min())
    fits = {}
    for name in GEOMETRIES:
        if name not in names:
            continue
        saved = fitting.load_fit(results / name / "fit.json")
        fits[name] = FittedGeometry(
            name, saved, _read(results / name / "figures.json"), _readings(data, saved),
            states_of(saved.muscle, pressures, shortest, _STROKE),
        )  # fmt: skip
    shown = SHAPE in names
    return Source(
        sheet, system, names, data, isobars, test, fits,
        measured_surface(sheet) if shown else None,
        Pictures.of(results / PICTURES / "measurements.nc") if shown else None,
        _read(results / SHAPE / "shape.json") if shown else None,
        pressures,
    )  # fmt: skip


def failed_pictures(source: Source) -> list[str]:
    """Names of the photographs that could not be measured, with the reason."""
    path = source.results / PICTURES / "measurements.csv"
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["ok"] != "true"]
    return [f"{Path(row['path']).name}, {row['error'].partition(':')[0]}" for row in rows]


def _readings(data: ForceData, saved: SavedFit) -> ForceData:
    """The force map as a fit was given it: without lengths that its geometry does not know."""
    readings = saved.document["data"]["readings"]
    lengths = np.array(readings["length_m"])
    if lengths.size == data.length.size:
        return data
    kept = np.isin(data.length, lengths)
    columns = {
        name: None if (values := getattr(data, name)) is None else values[kept] for name in COLUMNS
    }
    return dataclasses.replace(data, **columns)


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))
