"""What the report is made of, read back from the files of the steps before it, and the model's states.

No equilibrium is solved for the states: the free contraction is where a spline through the forces
falls to zero.
"""

import csv
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
import fitting
from famjax.boundary.units import factor, unit_system
from famjax.compile_options import quick_jit
from famjax.terms import BladderAxial, BladderHoop, BladderWall
from famjax.work import WorkBudget
from fitting.data import COLUMNS, ForceData
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
from ..folder import RESULTS, Sheet

PRESSURE = "pressure on the braid"
"""Name of the part of the force that is the braid's, the first of all."""
_RANGE = 129
"""Lengths over the whole range of a geometry: a cubic spline through them repeats a force to 1e-7."""


@dataclasses.dataclass(frozen=True)
class States:
    """A muscle over its stroke at several pressures; nan where its geometry is not known.

    Attributes:
        contraction: from rest to the end of the measured stroke, shape (c,).
        force: F [N] of the model, below zero where the muscle is slack; shape (p, c), as all that
            follow.
        diameter: of the braid, D [m]: the average one.
        braid_angle: theta [rad].
        thickness: of the wall [m].
        volume: within the outline [m3].
        axial_strain: eps_z.
        mean_hoop_strain: axial mean of eps_c.
        most_hoop_strain: largest eps_c along the axis.
        axial_stress, hoop_stress: axial means [Pa].
        terms: parts of the force [N] by name.
        rest_length: L0 [m].
        lengths: over the whole range of the geometry [m], falling, shape (r,).
        forces: there [N], shape (p, r).
    """

    contraction: np.ndarray
    force: np.ndarray
    diameter: np.ndarray
    braid_angle: np.ndarray
    thickness: np.ndarray
    volume: np.ndarray
    axial_strain: np.ndarray
    mean_hoop_strain: np.ndarray
    most_hoop_strain: np.ndarray
    axial_stress: np.ndarray
    hoop_stress: np.ndarray
    terms: dict[str, np.ndarray]
    rest_length: float
    lengths: np.ndarray
    forces: np.ndarray

    @property
    def blocked_force(self) -> np.ndarray:
        """Force [N] at zero contraction by pressure, 0 where slack; nan where it is not known."""
        return np.maximum(self.force[:, 0], 0.0)

    def free_contraction(self) -> np.ndarray:
        """Contraction at which the force first falls to zero, by pressure; nan where it does not."""
        return np.array([_first_zero(self.lengths, row, self.rest_length) for row in self.forces])


def states_of(muscle: famjax.Muscle, pressures: np.ndarray, shortest: float, count: int) -> States:
    """The states of a muscle, by one compiled program.

    Args:
        muscle: with a geometry and terms.
        pressures: gauge pressures [Pa], shape (p,).
        shortest: length at the end of the stroke [m].
        count: of lengths over the stroke.
    """
    rest = float(muscle.rest_length)
    ends = [float(end) for end in muscle.length_range()]
    stroke = np.linspace(rest, shortest, count)
    whole = np.linspace(min(rest, ends[1]), ends[0], _RANGE)
    found = {
        name: np.asarray(values)
        for name, values in _states(
            muscle, np.concatenate([stroke, whole]), pressures[:, None]
        ).items()
    }
    within = {name: values[..., :count] for name, values in found.items()}
    terms = {name[6:]: within.pop(name) for name in [*within] if name.startswith("term: ")}
    terms = dict(sorted(terms.items(), key=lambda one: one[0] != PRESSURE))
    return States(
        contraction=1 - stroke / rest, terms=terms, rest_length=rest, lengths=whole,
        forces=found["force"][:, count:], **within,
    )  # fmt: skip


@quick_jit
def _states(
    muscle: famjax.Muscle, lengths: famjax.Real, pressures: famjax.Real
) -> dict[str, Float[Array, "..."]]:
    L, P = jnp.broadcast_arrays(jnp.asarray(lengths), jnp.asarray(pressures))
    rated = any(term.uses_rates for term in muscle.terms.terms)
    geometry = muscle.geometry
    at = (geometry.dimensions_with_rates if rated else geometry.dimensions)(L, P)
    parts = _parts(muscle, at, P)
    weights, hoop = at.station_weights, at.hoop_strain
    content = {
        "force": jnp.asarray(sum(parts.values())),
        "diameter": 2 * at.radius,
        "braid_angle": at.braid_angle,
        "thickness": at.thickness,
        "volume": at.volume,
        "axial_strain": at.axial_strain,
        "mean_hoop_strain": jnp.sum(weights * hoop, axis=-1),
        "most_hoop_strain": jnp.max(hoop, axis=-1),
        **_stresses(muscle, at, P),
        **{f"term: {name}": part for name, part in parts.items()},
    }
    return jax.tree.map(lambda values: jnp.where(at.reached, values, jnp.nan), content)


def _parts(
    muscle: famjax.Muscle, at: famjax.geometries.Dimensions, pressure: Array
) -> dict[str, Array]:
    """Each term's part of the force [N]; the wall's in its two."""
    parts = {}
    for term in muscle.terms.terms:
        material = term.material if isinstance(term, BladderWall) else None
        if material is not None:
            parts["bladder, axial stress"] = BladderAxial(material).force(at, pressure)
            parts["bladder, hoop stress"] = BladderHoop(material).force(at, pressure)
        else:
            held = hasattr(term, "deadband_pressure")
            parts[PRESSURE if held else type(term).__name__] = term.force(at, pressure)
    return parts


def _stresses(
    muscle: famjax.Muscle, at: famjax.geometries.Dimensions, pressure: Array
) -> dict[str, Array]:
    axial, hoop = muscle.material.stresses(
        at.axial_strain[..., None], at.hoop_strain, pressure[..., None]
    )
    weights = at.station_weights
    return {
        "axial_stress": jnp.sum(weights * axial, axis=-1),
        "hoop_stress": jnp.sum(weights * hoop, axis=-1),
    }


def _first_zero(lengths: np.ndarray, force: np.ndarray, rest: float) -> float:
    """Contraction at the longest length at which a cubic spline of the force falls to zero."""
    from scipy.interpolate import CubicSpline

    known = np.isfinite(force)
    contraction = 1 - lengths[known] / rest
    if known.sum() < 4 or force[known][0] <= 0:
        return np.nan
    spline = CubicSpline(contraction, force[known])
    roots = np.sort(spline.roots(extrapolate=False))
    falling = roots[spline(roots, 1) < 0]
    return float(falling[0]) if falling.size else np.nan


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
        work: of the stroke at each pressure, from rest to the end or to where the pull ends.
    """

    name: str
    saved: SavedFit
    figures: dict[str, Any]
    data: ForceData
    states: States
    work: WorkBudget

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
        states = states_of(saved.muscle, pressures, shortest, _STROKE)
        rest = states.rest_length
        free = np.nan_to_num(states.free_contraction(), nan=np.inf)
        last = np.minimum(np.maximum(free, 1e-3), states.contraction[-1])
        fits[name] = FittedGeometry(
            name, saved, _read(results / name / "figures.json"), _readings(data, saved), states,
            famjax.work_budget(saved.muscle, pressures, rest, rest * (1 - last)),
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
