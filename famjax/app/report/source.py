"""Data for the report: fits, pictures and tables from a characterisation folder.

No equilibrium is computed: the free contraction is where a spline through the forces falls to zero.
"""

import dataclasses
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float

import famjax
import fitting
from famjax.boundary.units import factor, unit_system
from famjax.compile_options import quick_jit
from famjax.terms import BladderWall, wall_forces
from fitting.prediction import static_rows
from fitting.shapes import Pictures, ShapeSurface

from .. import evaluation
from ..folder import Sheet

PARTS = ("pressure on the braid", "bladder, axial stress", "bladder, hoop stress")
"""Names of the three contributions to the force."""
KINDS = {
    **dict.fromkeys(("diameter", "thickness", "length"), "length"), "braid_angle": "angle",
    **dict.fromkeys(("axial_stress", "hoop_stress"), "stress"), "volume": "volume",
    **dict.fromkeys(("pressure", "level"), "pressure"),
    **dict.fromkeys((
        "force", "blocked_force", "free_slope", "rmse", "largest", "rmse_left_out", "model", "low_95",
        "high_95", "model_less_measured", *PARTS,
    ), "force"),
}  # fmt: skip
"""Kind of quantity in each column that has a unit."""
_WORK = {
    "load": "load_J", "fluid": "fluid_J", "stored": "stored_J", "left_over": "left_over_J",
    "efficiency": "efficiency", "density": "work_per_volume_J_m3",
}  # fmt: skip
"""Column name for each field of the work budget."""
_RANGE = 129
"""Number of lengths over a geometry's range, enough for a cubic spline to match the force to 1e-7."""


@quick_jit
def _states(
    muscle: famjax.Muscle, lengths: famjax.Real, pressures: famjax.Real
) -> dict[str, Float[Array, "..."]]:
    """Return states and force contributions; strains and stresses are axial means; nan if unknown."""
    L, P = jnp.broadcast_arrays(jnp.asarray(lengths), jnp.asarray(pressures))
    geometry, terms = muscle.geometry, muscle.terms.terms
    rated = any(term.uses_rates for term in terms)
    at = (geometry.dimensions_with_rates if rated else geometry.dimensions)(L, P)
    weights, hoop = at.station_weights, at.hoop_strain
    axial_stress, hoop_stress = muscle.material.stresses(
        at.axial_strain[..., None], hoop, P[..., None]
    )
    forces = [sum(term.force(at, P) for term in terms if not isinstance(term, BladderWall))]
    forces += wall_forces(muscle.material, at, P)
    states = {
        "force": sum(forces),
        "diameter": 2 * at.radius,
        "braid_angle": at.braid_angle,
        "thickness": at.thickness,
        "volume": at.volume,
        "axial_strain": at.axial_strain,
        "mean_hoop_strain": jnp.sum(weights * hoop, axis=-1),
        "axial_stress": jnp.sum(weights * axial_stress, axis=-1),
        "hoop_stress": jnp.sum(weights * hoop_stress, axis=-1),
        **dict(zip(PARTS, forces, strict=True)),
    }
    return jax.tree.map(lambda values: jnp.where(at.reached, values, jnp.nan), states)


def _free(contraction: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Return the contraction at which a spline of the force first falls to zero, and its slope, or nan."""
    from scipy.interpolate import CubicSpline

    known = np.isfinite(force)
    if known.sum() < 4 or force[known][0] <= 0:
        return np.nan, np.nan
    spline = CubicSpline(contraction[known], force[known])
    roots = np.sort(spline.roots(extrapolate=False))
    falling = roots[spline(roots, 1) < 0]
    return (float(falling[0]), float(spline(falling[0], 1))) if falling.size else (np.nan, np.nan)


@dataclasses.dataclass(frozen=True)
class Source:
    """Contents of a characterisation folder and its results.

    Attributes:
        sheet: sheet in the folder.
        fits: fits by geometry.
        figures: contents of `figures.json` by geometry: force errors, and parameters with their errors.
        test: contents of `characterisation.json`, or {}.
        pressures: gauge pressures [Pa] held in the test, ascending.
        surface: shape surface fitted to the photographs, or None.
        pictures: measured pictures, or None.
        tables: states, readings, parameters, pressures and checks, in the report's units.
    """

    sheet: Sheet
    fits: dict[str, fitting.Identification]
    figures: dict[str, dict[str, Any]]
    test: dict[str, Any]
    pressures: np.ndarray
    surface: ShapeSurface | None
    pictures: Pictures | None
    tables: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def best(self) -> str:
        """Geometry of the fit shown in the report: the measured shape if there is one."""
        return evaluation.MEASURED if evaluation.MEASURED in self.fits else evaluation.CYLINDER

    def middle(self, geometry: str) -> Any:
        """Return the states of a geometry at the middle pressure."""
        states, middle = self.tables["states"], self.pressures[len(self.pressures) // 2]
        of = states.geometry == geometry
        return states[of & (states.pressure == self.scaled(middle, "pressure"))]

    def unit(self, kind: str) -> str:
        """Return the report's unit for a kind of quantity; volumes use cm3, not mm3."""
        unit = unit_system(self.sheet.units)[kind]
        return "cm3" if unit == "mm3" else unit

    def scaled(self, value: Any, kind: str) -> Any:
        """Convert an SI value or array to the report's unit."""
        return value / factor(self.unit(kind), kind)

    def number(self, value: float | None, kind: str, digits: int = 4) -> str:
        """Format a number for the page; return a dash if it is unknown."""
        if value is None or not np.isfinite(value):
            return "\N{EN DASH}"
        return f"{self.scaled(float(value), kind):.{digits}g}".replace("-", "\N{MINUS SIGN}")

    def pressure(self, value: float) -> str:
        """Format a pressure with its unit."""
        return f"{self.number(value, 'pressure', 3)} {self.unit('pressure')}"

    def table(self, columns: Mapping[str, Any]) -> Any:
        """Build a table in the report's units from columns in SI."""
        found = pd.DataFrame(columns)
        for name in found.columns.intersection([*KINDS]):
            found[name] = self.scaled(found[name].astype(float), KINDS[name])
        return found

    def csv(self, name: str) -> str:
        """Return a table as CSV. Each column name ends with its unit; unknown values are empty."""
        units = {one: f"_{self.unit(kind)}" for one, kind in KINDS.items()}
        names = {one: re.sub(",? ", "_", one) + units.get(one, "") for one in self.tables[name]}
        return (
            self.tables[name]
            .rename(columns=names)
            .to_csv(index=False, float_format="%.8g", lineterminator="\n")
        )


def read_source(sheet: Sheet, names: Sequence[str]) -> Source:
    """Read all data for the report, and evaluate each model once."""
    record = sheet.results / evaluation.RECORDS / evaluation.TEST
    test = _read(record) if record.exists() else {}
    data, shown = evaluation.read_map(sheet), sheet.photographs is not None
    held = [bar["pressure_Pa"] for bar in test.get("isobars", [])]
    source = Source(
        sheet, {name: fitting.load_fit(sheet.results / name / "fit.json") for name in names},
        {name: _read(sheet.results / name / evaluation.FIGURES) for name in names}, test,
        np.array(held or np.unique(data.pressures.level[data.loaded])),
        evaluation.measured_surface(sheet) if shown else None,
        Pictures.of(sheet.results / evaluation.PICTURES / "measurements.nc") if shown else None,
    )  # fmt: skip
    every = [_of_geometry(source, name, float(data.length.min())) for name in names]
    states, ends = ([*one] for one in zip(*every, strict=True))
    if held:
        bars = pd.DataFrame(test["isobars"]).rename(columns={"blocked_force_N": "blocked_force"})
        bars = bars[["blocked_force", "free_contraction"]].astype(float)
        ends.append(source.table({"geometry": "test", "pressure": source.pressures, **bars}))
    source.tables.update({
        "states": pd.concat(states), "pressures": pd.concat(ends), "readings": _readings(source),
        "parameters": _parameters(source),
        "checks": pd.DataFrame(evaluation.checks_of(sheet)),
    })  # fmt: skip
    return source


def _of_geometry(source: Source, name: str, shortest: float) -> tuple[Any, Any]:
    """Tabulate a model's states over the stroke and, for each pressure, its end points, errors and work."""
    fit, P = source.fits[name], source.pressures
    muscle: Any = fit.muscle
    rest = float(muscle.rest_length)
    lengths = np.linspace(rest, float(muscle.length_range()[0]), _RANGE)
    contraction = 1 - lengths / rest
    states = jax.tree.map(np.asarray, _states(muscle, lengths, P[:, None]))
    columns = {"pressure": np.repeat(P, _RANGE), "contraction": np.tile(contraction, P.size)}
    columns |= {key: values.ravel() for key, values in states.items()}
    table = source.table({"geometry": name, **columns})
    free, slope = np.array([_free(contraction, row) for row in states["force"]]).T
    last = np.clip(np.nan_to_num(free, nan=np.inf), 1e-3, 1 - shortest / rest)
    budget = famjax.work_budget(muscle, P, rest, rest * (1 - last))
    work = {column: np.asarray(getattr(budget, name)) for name, column in _WORK.items()}
    out = fit.document.get("leave_one_pressure_out") or {"left_out": [], "group_rmse_N": []}
    near, near_out = (
        np.abs(np.array(levels, float) - P[:, None]).argmin(axis=0)
        for levels in (fit.data.pressures.level[fit.data.loaded], out["left_out"])
    )
    squares: Any = pd.Series(fit.residuals**2).groupby(near)
    ends = {
        "geometry": name, "pressure": P, "free_contraction": free, "free_slope": slope,
        "blocked_force": np.maximum(states["force"][:, 0], 0.0),
        "rmse": np.sqrt(squares.mean()).reindex(range(P.size)),
        "largest": np.sqrt(squares.max()).reindex(range(P.size)),
        "rmse_left_out": pd.Series(out["group_rmse_N"], dtype=float).groupby(near_out).mean(),
        **work, "left_over_share": work["left_over_J"] / work["fluid_J"],
    }  # fmt: skip
    return table[table.contraction <= 1 - shortest / rest], source.table(ends)


def _readings(source: Source) -> pd.DataFrame:
    """Tabulate the readings under load with the model's force, its 95 % band and the residuals."""
    fit = source.fits[source.best]
    data, pulls = fit.data, fit.data.loaded
    found = pd.DataFrame(static_rows(fit, data.length[pulls], data.pressure[pulls]))
    columns = {name: getattr(data, name)[pulls] for name in ("pressure", "length", "force")}
    names = {"model": "force_N", "low_95": "low_95_N", "high_95": "high_95_N"}
    columns |= {name: found[key].to_numpy(float) for name, key in names.items()}
    columns |= {"model_less_measured": fit.residuals, "level": data.pressures.level[pulls]}
    return source.table(columns)


def _parameters(source: Source) -> pd.DataFrame:
    """Tabulate the parameters of each geometry, with their standard errors by source."""
    frames = []
    for geometry, of in source.figures.items():
        columns = {"value": of["values"], "std": of["std"], "std_of_scatter": of["std_of_scatter"]}
        found = pd.DataFrame(
            columns | {f"std_of_{one}": v for one, v in of["std_by_source"].items()}
        )
        kinds = [parameter_kind(source, name) for name in found.index]
        units = [source.unit(kind) for kind in kinds]
        found = found.mul([source.scaled(1.0, kind) for kind in kinds], axis=0)
        entries = source.fits[geometry].document["parameters"]
        bound = [bool(entries.get(name, {}).get("at_bound")) for name in found.index]
        frames.append(found.assign(geometry=geometry, unit=units, at_bound=bound))
    return pd.concat(frames).rename_axis("parameter").reset_index()


def parameter_kind(source: Source, name: str) -> str:
    """Return the kind of quantity of an identified parameter, such as "length"."""
    entries = [fit.document["parameters"] for fit in source.fits.values()]
    return next((one[name]["kind"] for one in entries if name in one), "number")


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))
