"""The figures of a characterisation as rows of a table and as JSON, in the units asked for."""

import math

from famjax.boundary.units import factor, unit_system
from fitting.records import Characterisation

from .isobaric_analysis import Analysis


def table_rows(found: Characterisation, system: str) -> list[dict[str, float | str]]:
    """One row for every isobar, the units in the keys; "none" for what was not measured.

    Raises:
        InputError: an unknown system.
    """
    units = unit_system(system)
    pressure, force = units["pressure"], units["force"]
    Pa, N = factor(pressure, "pressure"), factor(force, "force")
    rows: list[dict[str, float | str]] = []
    for bar in found.isobars:
        row = {
            f"set_{pressure}": bar.set_pressure / Pa,
            f"mean_{pressure}": bar.pressure / Pa,
            f"std_{pressure}": bar.pressure_std / Pa,
            f"largest_error_{pressure}": bar.largest_pressure_error / Pa,
            "cycles": bar.cycles,
            f"blocked_{force}": bar.blocked_force / N,
            "free_contraction": bar.free_contraction,
            "hysteresis_J": bar.hysteresis,
            "hysteresis_ratio": bar.hysteresis_ratio,
        }
        rows.append({k: v if math.isfinite(v) else "none" for k, v in row.items()})
    return rows


def figures(found: Analysis) -> dict[str, object]:
    """The figures of an analysis for a JSON file, unit in each key; None for what was not measured."""
    rows = [
        {key: value if math.isfinite(value) else None for key, value in row.items()}
        for row in found.characterisation.rows()
    ]
    aligned = found.alignment
    residual = "residual_N" if aligned.method == "load" else "residual_s"
    alignment = {
        "method": aligned.method,
        "offset_s": aligned.offset,
        "reference_s": aligned.reference,
        "offset_error_s": aligned.offset_error,
        "rate": aligned.rate,
        "rate_error": aligned.rate_error if math.isfinite(aligned.rate_error) else None,
        residual: aligned.residual,
    }
    return {"isobars": rows, "alignment": alignment, "notes": list(found.characterisation.notes)}


def branches_csv(muscle: Characterisation) -> str:
    """Both branches of every isobar over the length as CSV, SI; empty for what was not measured."""
    lines = ["set_pressure_Pa,length_m,shortening_N,lengthening_N"]
    for bar in muscle.isobars:
        for row in zip(bar.length, bar.shortening, bar.lengthening, strict=True):
            cells = ("" if math.isnan(value) else f"{value:.8g}" for value in row)
            lines.append(f"{bar.set_pressure:.8g},{','.join(cells)}")
    return "\n".join(lines) + "\n"
