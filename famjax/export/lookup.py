"""Tables of force over length and pressure: CSV, and MATLAB's .mat."""

import io
from typing import Any

import numpy as np

from .subject import Subject

_LENGTHS, _PRESSURES = 129, 41
_BEYOND = 0.5  # of the way from the data to a stop


def csv_files(subject: Subject) -> dict[str, bytes]:
    """One row for each state, `length_m,pressure_Pa,force_N,model_force_N,stiffness_N_per_m,area_m2`."""
    grid, about = _grid(subject)
    lines = [*(f"# {line}" for line in about), ",".join(grid)]
    L, P = np.meshgrid(grid["length_m"], grid["pressure_Pa"], indexing="ij")
    columns = [L, P, *list(grid.values())[2:]]
    lines += [
        ",".join(map(repr, row))
        for row in zip(*(column.ravel().tolist() for column in columns), strict=True)
    ]
    return {f"{subject.identifier}.csv": "\n".join([*lines, ""]).encode()}


def mat_files(subject: Subject) -> dict[str, bytes]:
    """Axes and tables of the CSV file by the same names, for a 2-D Lookup Table block."""
    from scipy.io import savemat  # noqa: PLC0415 -- slow to import

    grid, about = _grid(subject)
    content: dict[str, Any] = {**grid, "about": "\n".join(about)}
    written = io.BytesIO()
    savemat(written, content, oned_as="column", do_compression=True)
    return {f"{subject.identifier}.mat": written.getvalue()}


def _grid(subject: Subject) -> tuple[dict[str, np.ndarray], list[str]]:
    """Axes and tables, with lines on them; how far a straight line between entries is off."""
    pull, table = subject.pull, subject.table
    (short, long), (first, last) = table["stops_m"], (pull.lengths[0], pull.lengths[-1])
    L = np.linspace(first + _BEYOND * (short - first), last + _BEYOND * (long - last), _LENGTHS)
    P = np.linspace(0.0, pull.pressures[-1], _PRESSURES)
    force, model, stiffness, area = (
        np.array([[ask(one, at) for at in P.tolist()] for one in L.tolist()])
        for ask in (pull.force, pull.model_force, pull.stiffness, pull.area)
    )
    middles = 0.5 * (L[1:] + L[:-1]), 0.5 * (P[1:] + P[:-1])
    true = np.array([[pull.force(one, at) for at in middles[1]] for one in middles[0]])
    straight = 0.25 * (force[1:, 1:] + force[:-1, 1:] + force[1:, :-1] + force[:-1, :-1])
    off = np.abs(straight - true) / subject.errors.largest_force
    # A cell that slack ends in holds a bend, and the least of its corners is slack.
    corners = np.minimum(force[:-1, :-1], force[1:, :-1])  # the force rises with the pressure
    taut = corners > pull.slack_width
    about = [
        *subject.about_table,
        f"bilinear interpolation between its entries is off by {off[taut].max():.1e} of the largest "
        f"force, by {off.max():.1e} where the muscle goes slack",
        "model_force_N is what the model says, not cut at zero: below zero where the muscle is slack",
        "beyond its ends nothing stops the muscle: extend it by the exported C or MATLAB functions",
    ]
    grid = {
        "length_m": L, "pressure_Pa": P, "force_N": force, "model_force_N": model,
        "stiffness_N_per_m": stiffness, "area_m2": area,
    }  # fmt: skip
    return grid, about
