"""Data of the report, read from the files of earlier steps, and the states of the models.

No equilibrium is solved for the states: the free contraction is where a spline through the forces
falls to zero.
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
from famjax.terms import BladderAxial, BladderHoop, BladderWall
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
from ..folder import RESULTS, Sheet

PRESSURE = "pressure on the braid"
"""Name of the part of the force that is the braid's, the first of all."""
KINDS = {
    "force": "force", "diameter": "length", "braid_angle": "angle", "thickness": "length",
    "volume": "volume", "axial_strain": "number", "mean_hoop_strain": "number",
    "most_hoop_strain": "number", "axial_stress": "stress", "hoop_stress": "stress",
}  # fmt: skip
"""Of the states of a muscle that have a column in the table."""
_RANGE = 129
"""Lengths over the whole range of a geometry: a cubic spline through them repeats a force to 1e-7."""


def states_of(
    muscle: famjax.Muscle, pressures: np.ndarray, shortest: float, count: int
) -> xarray.Dataset:
    """The states of a muscle in SI over its stroke at several pressures, by one compiled program.

    Args:
        muscle: with a geometry and terms.
        pressures: gauge pressures [Pa], shape (p,).
        shortest: length at the end of the stroke [m].
        count: of lengths over the stroke.

    Returns:
        By pressure and contraction the quantities of `KINDS`, nan where the geometry is not known: strains
        and stresses are axial means but for `most_hoop_strain`; `terms` are the parts of the force by term.
        By pressure: `blocked_force`, 0 where the muscle is slack; `free_contraction`, where the force
        first falls to zero, nan where it does not, and `free_slope`, the force's there by contraction.
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
            parts["bladder, axial stress"] = BladderAxial(term.material).force(at, P)
            parts["bladder, hoop stress"] = BladderHoop(term.material).force(at, P)
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
    """The first contraction at which a cubic spline of the force falls to zero, and its slope there."""
    from scipy.interpolate import CubicSpline

    known = np.isfinite(force)
    if known.sum() < 4 or force[known][0] <= 0:
        return np.nan, np.nan
    spline = CubicSpline(contraction[known], force[known])
    roots = np.sort(spline.roots(extrapolate=False))
    falling = roots[spline(roots, 1) < 0]
    return (float(falling[0]), float(spline(falling[0], 1))) if falling.size else (np.nan, np.nan)


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
        states: of the model, see `states_of`.
        work: of the stroke at each pressure, from rest to the end or to where the pull ends.
    """

    name: str
    saved: fitting.Identification
    figures: dict[str, Any]
    data: ForceData
    states: xarray.Dataset
    work: WorkBudget

    @property
    def title(self) -> str:
        """What the geometry is."""
        return GEOMETRIES[self.name]

    @property
    def short(self) -> str:
        """Short title for legends and headers."""
        return self.name.replace("-", " ")

    @property
    def residuals(self) -> np.ndarray:
        """Model less measured [N] at the loaded readings."""
        return self.saved.residuals

    @property
    def levels(self) -> np.ndarray:
        """Pressure level [Pa] of the loaded readings."""
        return self.data.pressures.level[self.data.loaded]


@dataclasses.dataclass(frozen=True)
class Source:
    """The contents of the folder and of its results.

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
        """The fit that the report shows: the one with the measured shape, if there is one."""
        return self.fits[MEASURED if MEASURED in self.fits else CYLINDER]

    @property
    def middle(self) -> int:
        """Index of the pressure at which curves over contraction are shown."""
        return len(self.pressures) // 2

    def unit(self, kind: str) -> str:
        """Of the report, for a kind of quantity; a muscle's volume is shown in cm3, not mm3."""
        unit = unit_system(self.system)[kind]
        return "cm3" if unit == "mm3" else unit

    def scaled(self, value: Any, kind: str) -> Any:
        """An SI value or array in the report's unit."""
        return value / factor(self.unit(kind), kind)

    def number(self, value: float | None, kind: str = "number", digits: int = 4) -> str:
        """A number of the page; a dash if it is not known."""
        if value is None or not np.isfinite(value):
            return "\N{EN DASH}"
        return f"{self.scaled(float(value), kind):.{digits}g}".replace("-", MINUS)

    def pressure(self, value: float) -> str:
        """A pressure with its unit."""
        return f"{self.number(value, 'pressure', 3)} {self.unit('pressure')}"


def read_source(sheet: Sheet, names: Sequence[str], system: str) -> Source:
    """Read everything for the report; each model is evaluated once."""
    results, data, shown = sheet.folder / RESULTS, read_map(sheet), SHAPE in names
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
    """The force map as a fit was given it: without lengths that its geometry does not know."""
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
