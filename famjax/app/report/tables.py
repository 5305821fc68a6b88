"""The tables beside the report, as CSV in its units: states, readings, parameters, errors, pressures."""

import csv
import io
from collections.abc import Iterable, Sequence

import numpy as np

from fitting.prediction.forces import static_rows

from ..checks import AGREES, read_checks
from .figures import by_level
from .source import Source

_STATES = {
    "force": "force", "diameter": "length", "braid_angle": "angle", "thickness": "length",
    "volume": "volume", "axial_strain": "number", "mean_hoop_strain": "number",
    "most_hoop_strain": "number", "axial_stress": "stress", "hoop_stress": "stress",
}  # fmt: skip
"""Fields of `States` and their kinds."""
_KINDS = {"Pa": "stress", "m": "length", "rad": "angle", "": "number"}


def tables(source: Source) -> dict[str, str]:
    """The tables by their files' names."""
    return {
        "states.csv": _states(source),
        "readings.csv": _readings(source),
        "parameters.csv": _parameters(source),
        "errors.csv": _errors(source),
        "pressures.csv": _pressures(source),
        "checks.csv": _checks(source),
    }


def parameter_kind(source: Source, name: str) -> str:
    """Kind of quantity of an identified number."""
    for fit in source.fits.values():
        entry = fit.saved.document["parameters"].get(name)
        if entry is not None:
            unit = str(entry["unit"])
            pressure = unit == "Pa" and name.endswith("pressure")
            return "pressure" if pressure else _KINDS.get(unit, unit)
    return "number"


def _states(source: Source) -> str:
    """What each model says over contraction, at every pressure."""
    terms = dict.fromkeys(term for fit in source.fits.values() for term in fit.states.terms)
    named = [_column(source, name, kind) for name, kind in _STATES.items()]
    header = ["geometry", _column(source, "pressure", "pressure"), "contraction", *named]
    header += [
        _column(source, term.replace(", ", " ").replace(" ", "_"), "force") for term in terms
    ]
    rows = []
    for fit in source.fits.values():
        of = fit.states
        unknown = np.full(of.force.shape, np.nan)
        columns = [source.scaled(getattr(of, name), kind) for name, kind in _STATES.items()]
        columns += [source.scaled(of.terms.get(term, unknown), "force") for term in terms]
        for k, pressure in enumerate(source.scaled(source.pressures, "pressure")):
            for j, contraction in enumerate(of.contraction):
                rows.append([fit.name, pressure, contraction, *(one[k, j] for one in columns)])
    return _text(header, rows)


def _readings(source: Source) -> str:
    """The readings that pull, with the model's force, its 95 % band and what each geometry leaves."""
    fit = source.best
    data = fit.data
    pulls = np.flatnonzero(data.loaded)
    found = static_rows(fit.saved, data.length[pulls], data.pressure[pulls])
    header = [_column(source, "pressure", "pressure"), _column(source, "length", "length")]
    header += [
        _column(source, name, "force")
        for name in ("force", "model", "low_95", "high_95", "model_less_measured")
    ]
    rows = [
        [source.scaled(data.pressure[k], "pressure"), source.scaled(data.length[k], "length"),
         source.scaled(data.force[k], "force"),
         *(_scaled(source, row[key], "force") for key in ("force_N", "low_95_N", "high_95_N")),
         source.scaled(left, "force")]
        for k, row, left in zip(pulls, found, fit.residuals, strict=True)
    ]  # fmt: skip
    return _text(header, rows)


def _parameters(source: Source) -> str:
    """What was identified with each geometry, with its standard errors by source."""
    sources = dict.fromkeys(
        one for fit in source.fits.values() for one in fit.figures["std_by_source"]
    )
    header = ["geometry", "parameter", "unit", "value", "std", "std_of_scatter"]
    rows = []
    for fit in source.fits.values():
        for name, value in fit.figures["values"].items():
            entry = fit.saved.document["parameters"].get(name, {})
            if entry.get("fixed"):
                continue
            kind = parameter_kind(source, name)
            numbers = (value, fit.figures["std"].get(name), fit.figures["std_of_scatter"].get(name))
            shared = [fit.figures["std_by_source"].get(one, {}).get(name) for one in sources]
            rows.append(
                [fit.name, name, source.unit(kind),
                 *(_scaled(source, one, kind) for one in (*numbers, *shared)),
                 bool(entry.get("at_bound"))]
            )  # fmt: skip
    return _text([*header, *(f"std_of_{one}" for one in sources), "at_bound"], rows)


def _errors(source: Source) -> str:
    """RMSE and largest error of each geometry, over all and at each pressure, and while left out."""
    header = ["geometry", _column(source, "pressure", "pressure")]
    header += [_column(source, one, "force") for one in ("rmse", "largest", "rmse_left_out")]
    rows = []
    for fit in source.fits.values():
        of = fit.figures
        every = {"all": (of["rmse_N"], of["largest_N"], of.get("left_out_pressure_N"))}
        for level, errors in (every | by_level(fit)).items():
            at = level if isinstance(level, str) else source.scaled(level, "pressure")
            rows.append([fit.name, at, *(_scaled(source, one, "force") for one in errors)])
    return _text(header, rows)


def _pressures(source: Source) -> str:
    """Blocked force and free contraction by pressure: measured, and of each geometry."""
    N = source.unit("force")
    header = [_column(source, "pressure", "pressure"), f"blocked_force_{N}", "free_contraction"]
    for fit in source.fits.values():
        header += [f"blocked_force_{fit.name}_{N}", f"free_contraction_{fit.name}"]
    rows = []
    for k, pressure in enumerate(source.pressures):
        bar = source.isobars[k] if source.isobars else {}
        blocked = _scaled(source, bar.get("blocked_force_N"), "force")
        row = [source.scaled(pressure, "pressure"), blocked, bar.get("free_contraction")]
        for fit in source.fits.values():
            free = fit.states.free_contraction()[k]
            row += [source.scaled(fit.states.blocked_force[k], "force"), free]
        rows.append(row)
    return _text(header, rows)


def _checks(source: Source) -> str:
    """What two sources say of one thing."""
    found = [one for place in source.steps for one in read_checks(place)]
    rows = [
        (one.what, one.range, one.value, one.verdict, one.say if one.verdict != AGREES else "")
        for one in found
    ]
    return _text(["what", "expected", "found", "verdict", "what_to_do"], rows)


def _column(source: Source, name: str, kind: str) -> str:
    unit = source.unit(kind)
    return f"{name}_{unit}" if unit else name


def _scaled(source: Source, value: float | None, kind: str) -> float | None:
    return None if value is None else source.scaled(float(value), kind)


def _text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """CSV; empty is what is not known."""
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow([_cell(one) for one in row])
    return lines.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, float | np.floating):
        return f"{value:.8g}" if np.isfinite(value) else ""
    return "" if value is None else value
