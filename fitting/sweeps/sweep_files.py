"""What `famjax sweep` does besides parsing: sweep, files and the rows to print."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import famjax
from famjax.boundary.files import as_png, check_output, make_output, write_all
from famjax.boundary.units import finite_or_none, from_si, unit_system

from ..data import ForceData
from .all_forms import sweep
from .result import SweepRow
from .sweep_plot import plot_curves, plot_errors, rows_of

SWEEP_FILE = "sweep.json"
"""All fits with their coefficients, in the output folder."""
REPLICATES = "replicates.jsonl"
"""Where the finished parts of a bootstrap are kept, in the output folder."""

_CURVES = 3


def sweep_command(
    data: Sequence[ForceData],
    geometry: famjax.geometries.AbstractGeometry | Sequence[famjax.geometries.AbstractGeometry],
    *,
    output: Path = Path("famjax-sweep"),
    units: str = "metric",
    bootstrap: int = 0,
    **options: Any,
) -> tuple[dict[str, Any], list[Path]]:
    """All permutations of the law for some force maps, with their files.

    Writes `sweep.json` with all fits in SI, and for each force map pictures of errors and force
    curves. The parts of a bootstrap are kept in a file, from which a stopped sweep goes on.

    Args:
        data: the force maps.
        geometry: of all of them, or one for each.
        output: folder, made if need be.
        units: "si", "metric" or "us", of pictures and rows.
        bootstrap: number of replicates.
        options: of `sweep`.

    Returns:
        A document for JSON with the rows, and the files.

    Raises:
        InputError: the data, the options or the folder cannot be used.
    """
    check_output(output)
    make_output(output)
    kept = output / REPLICATES if bootstrap else None
    found = sweep(data, geometry, bootstrap=bootstrap, **options, resume=kept)
    rows = {"rows": [row.as_dict() for row in found.rows]}
    files = {SWEEP_FILE: msgspec.json.encode(rows)}  # nan as null
    for index in range(len(found.data)):
        best = sorted(rows_of(found, index), key=lambda row: row.bic)[:_CURVES]
        for name, figure in (
            ("errors", plot_errors(found, units, index)),
            ("curves", plot_curves(found, best, units, index)),
        ):
            files[f"{name}-{index + 1}.png"] = as_png(figure)
    document = {"rows": [table_row(row, units) for row in found.rows]}
    return document, write_all(output, files)


def table_row(row: SweepRow, system: str) -> dict[str, Any]:
    """One line of the table, the unit in each name; what is not known is null."""
    force, stress = unit_system(system)["force"], unit_system(system)["stress"]
    numbers = {
        f"rmse_{force}": from_si(row.rmse, force, "force"),
        f"mae_{force}": from_si(row.mae, force, "force"),
        f"blocked_force_error_{force}": from_si(row.blocked_error, force, "force"),
        "free_contraction_error": row.free_contraction_error,
        "aicc": row.aicc,
        "bic": row.bic,
        f"left_out_rmse_{force}": from_si(row.cross_validated_rmse, force, "force"),
        f"stability_margin_{stress}": from_si(row.margin, stress, "stress"),
        "condition": row.condition,
    }
    return {
        "data": row.data,
        "pressure": row.dependence,
        "order": row.order,
        "constraint": row.constraint,
        "n_coefficients": row.n_coefficients,
        **{name: finite_or_none(value) for name, value in numbers.items()},
        "n_free_contractions": int(np.isfinite(row.free_contraction_error_by_pressure).sum()),
        "verdict": row.verdict,
    }
