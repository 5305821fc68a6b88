"""Data of the report: files of earlier steps and states of the models.

No equilibrium is solved. The free contraction is where a spline through the forces falls to zero.
"""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray
from jaxtyping import Array, Float

import famjax
import fitting
from famjax.boundary.units import factor, unit_system
from famjax.compile_options import quick_jit
from famjax.terms import BladderWall, wall_forces
from famjax.work import WorkBudget
from fitting.data import COLUMNS, ForceData
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
from ..folder import Sheet

PRESSURE = "pressure on the braid"
"""Name of the braid's part of the force, shown first."""
KINDS = {
    "force": "force", "diameter": "length", "braid_angle": "angle", "thickness": "length",
    "volume": "volume", "axial_strain": "number", "mean_hoop_strain": "number",
    "most_hoop_strain": "number", "axial_stress": "stress", "hoop_stress": "stress",
}  # fmt: skip
"""State variables with a column in the table, and their kinds."""
_RANGE = 129
"""Lengths over the full range of a geometry: a cubic spline through them reproduces a force to 1e-7."""


def states_of(
    muscle: famjax.Muscle, pressures: np.ndarray, shortest: float, count: int
) -> xarray.Dataset:
    """Compute the states of a muscle in SI over its stroke at several pressures.

    Args:
        muscle: muscle with a geometry and terms.
        pressures: gauge pressures [Pa], shape (p,).
        shortest: length at the end of the stroke [m].
        count: number of lengths over the stroke.

    Returns:
        By pressure and contraction, the quantities of `KINDS`, nan where the geometry is unknown. Strains
        and stresses are axial means, except `most_hoop_strain`. `terms` holds the force of each term.
        By pressure, `blocked_force` (0 if slack), `free_contraction`, where the force first falls to
        zero (nan if it does not), and `free_slope`, the derivative of force by contraction there.
    """
    rest = float(muscle.rest_length)
    ends = [float(end) for end in muscle.length_range()]
    stroke = np.linspace(rest, shortest, count)
    whole = np.linspace(min(rest, ends[1]), ends[0], _RANGE)
    every = np.concatenate([stroke, whole])
    found = {k: np.asarray(v) for k, v in _states(muscle, every, pressures[:, None]).items()}
    terms = [name for name in found if name not in KINDS]
    terms.sort(key=lambda name: name != PRESSURE)
    free = np.array([_first_zero(1 - whole / rest, row[count:]) for row in found["force"]])
    across = ("pressure", "contraction")
    return xarray.Dataset(
        {
            **{name: (across, found[name][:, :count]) for name in KINDS},
            "terms": (("term", *across), np.stack([found[name][:, :count] for name in terms])),
            "blocked_force": ("pressure", np.maximum(found["force"][:, 0], 0.0)),
            "free_contraction": ("pressure", free[:, 0]),
            "free_slope": ("pressure", free[:, 1]),
        },
        {"pressure": pressures, "contraction": 1 - stroke / rest, "term": terms},
    )


@quick_jit
def _states(
    muscle: famjax.Muscle, lengths: famjax.Real, pressures: famjax.Real
) -> dict[str, Float[Array, "..."]]:
    L, P = jnp.broadcast_arrays(jnp.asarray(lengths), jnp.asarray(pressures))
    rated = any(term.uses_rates for term in muscle.terms.terms)
    geometry = muscle.geometry
    at = (geometry.dimensions_with_rates if rated else geometry.dimensions)(L, P)
    weights, hoop = at.station_weights, at.hoop_strain
    axial_stress, hoop_stress = muscle.material.stresses(
        at.axial_strain[..., None], hoop, P[..., None]
    )
    parts = {}
    for term in muscle.terms.terms:
        if isinstance(term, BladderWall):
            pulls = wall_forces(term.material, at, P)
            parts["bladder, axial stress"], parts["bladder, hoop stress"] = pulls
        else:
            of_braid = hasattr(term, "deadband_pressure")
            parts[PRESSURE if of_braid else type(term).__name__] = term.force(at, P)
    content = {
        "force": jnp.asarray(sum(parts.values())),
        "diameter": 2 * at.radius,
        "braid_angle": at.braid_angle,
        "thickness": at.thickness,
        "volume": at.volume,
        "axial_strain": at.axial_strain,
        "mean_hoop_strain": jnp.sum(weights * hoop, axis=-1),
        "most_hoop_strain": jnp.max(hoop, axis=-1),
        "axial_stress": jnp.sum(weights * axial_stress, axis=-1),
        "hoop_stress": jnp.sum(weights * hoop_stress, axis=-1),
        **parts,
    }
    return jax.tree.map(lambda values: jnp.where(at.reached, values, jnp.nan), content)


def _first_zero(contraction: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Return where a cubic spline of the force first falls to zero, and its slope there."""
    from scipy.interpolate import CubicSpline

    known = np.isfinite(force)
    if known.sum() < 4 or force[known][0] <= 0:
        return np.nan, np.nan
    spline = CubicSpline(contraction[known], force[known])
    roots = np.sort(spline.roots(extrapolate=False))
    falling = roots[spline(roots, 1) < 0]
    return (float(falling[0]), float(spline(falling[0], 1))) if falling.size else (np.nan, np.nan)


COLOURS = dict(zip(GEOMETRIES, ("0.35", "0.65", "#e69f00", "#0072b2", "#009e73"), strict=True))
"""Colours of the geometries in every chart; distinguishable with red-green blindness."""
DASHES = dict(zip(GEOMETRIES, ("--", "--", "-.", "-", ":"), strict=True))
MINUS = "\N{MINUS SIGN}"
_STROKE = 41
"""Number of lengths over the measured stroke at which the models are evaluated."""


@dataclasses.dataclass(frozen=True)
class FittedGeometry:
    """Fit of one geometry.

    Attributes:
        name: name of the geometry and of its step.
        saved: the fit.
        figures: contents of the step's `figures.json`: errors, parameter values and their errors.
        data: readings used in the fit.
        states: states of the model, see `states_of`.
        work: work of the stroke at each pressure, from rest to the end or to zero force.
    """

    name: str
    saved: fitting.Identification
    figures: dict[str, Any]
    data: ForceData
    states: xarray.Dataset
    work: WorkBudget

    @property
    def title(self) -> str:
        """Description of the geometry."""
        return GEOMETRIES[self.name]

    @property
    def short(self) -> str:
        """Short name for legends and headers."""
        return self.name.replace("-", " ")

    @property
    def residuals(self) -> np.ndarray:
        """Model minus measured force [N] at the loaded readings."""
        return self.saved.residuals

    @property
    def levels(self) -> np.ndarray:
        """Pressure level [Pa] of the loaded readings."""
        return self.data.pressures.level[self.data.loaded]


@dataclasses.dataclass(frozen=True)
class Source:
    """Contents of the folder and its results.

    Attributes:
        sheet: sheet of the folder.
        system: unit system.
        names: names of the steps.
        data: force map.
        isobars: figures of the test by set pressure; empty without a journal.
        test: contents of `characterisation.json`, or {}.
        fits: fits by geometry.
        surface: surface through the photographs, or None.
        pictures: measured pictures, or None.
        shape: contents of `shape.json`, or None.
        pressures: gauge pressures [Pa] held in the test, ascending.
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
    def steps(self) -> list[Path]:
        """Folders of all steps."""
        return [self.sheet.results / name for name in self.names]

    @property
    def best(self) -> FittedGeometry:
        """The fit shown in the report: with the measured shape if there is one."""
        return self.fits[MEASURED if MEASURED in self.fits else CYLINDER]

    @property
    def middle(self) -> int:
        """Index of the pressure for curves over contraction."""
        return len(self.pressures) // 2

    def unit(self, kind: str) -> str:
        """Return the report's unit for a kind of quantity; volumes use cm3, not mm3."""
        unit = unit_system(self.system)[kind]
        return "cm3" if unit == "mm3" else unit

    def scaled(self, value: Any, kind: str) -> Any:
        """Convert an SI value or array to the report's unit."""
        return value / factor(self.unit(kind), kind)

    def number(self, value: float | None, kind: str = "number", digits: int = 4) -> str:
        """Format a number for the page; a dash if it is unknown."""
        if value is None or not np.isfinite(value):
            return "\N{EN DASH}"
        return f"{self.scaled(float(value), kind):.{digits}g}".replace("-", MINUS)

    def pressure(self, value: float) -> str:
        """Format a pressure with its unit."""
        return f"{self.number(value, 'pressure', 3)} {self.unit('pressure')}"


def read_source(sheet: Sheet, names: Sequence[str], system: str) -> Source:
    """Read all data of the report and evaluate each model once."""
    results, data, shown = sheet.results, read_map(sheet), SHAPE in names
    record = results / RECORDS / "characterisation.json"
    test = _read(record) if record.exists() else {}
    isobars = test.get("isobars", [])
    held = [bar["pressure_Pa"] for bar in isobars]
    pressures = np.array(held or np.unique(data.pressures.level[data.loaded]))
    fits = {}
    for name in (one for one in GEOMETRIES if one in names):
        saved = fitting.load_fit(results / name / "fit.json")
        muscle = saved.muscle
        assert isinstance(muscle, famjax.Muscle)
        states = states_of(muscle, pressures, float(data.length.min()), _STROKE)
        rest, ends = float(muscle.rest_length), states.free_contraction.fillna(np.inf)
        last = np.clip(ends.values, 1e-3, float(states.contraction[-1]))
        fits[name] = FittedGeometry(
            name, saved, _read(results / name / "figures.json"), _readings(data, saved), states,
            famjax.work_budget(muscle, pressures, rest, rest * (1 - last)),
        )  # fmt: skip
    return Source(
        sheet, system, names, data, isobars, test, fits,
        measured_surface(sheet) if shown else None,
        Pictures.of(results / PICTURES / "measurements.nc") if shown else None,
        _read(results / SHAPE / "shape.json") if shown else None,
        pressures,
    )  # fmt: skip


def _readings(data: ForceData, saved: fitting.Identification) -> ForceData:
    """Return the readings used in a fit: without lengths outside its geometry."""
    lengths = np.array(saved.document["data"]["readings"]["length_m"])
    if lengths.size == data.length.size:
        return data
    kept = np.isin(data.length, lengths)
    columns = {
        name: None if (values := getattr(data, name)) is None else values[kept] for name in COLUMNS
    }
    return dataclasses.replace(data, **columns)


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))
