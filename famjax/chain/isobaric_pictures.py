"""Pictures of a test: force over contraction, and the pressure that was held."""

import numpy as np
from matplotlib.figure import Figure

from famjax.boundary.units import factor, unit_system

from .isobaric_analysis import Analysis

_MOST_POINTS = 20_000  # drawn of a pressure record


def plot_characterisation(found: Analysis, system: str = "metric") -> Figure:
    """Both branches over contraction at every set pressure, and the error of the pressure in time.

    Args:
        found: the analysis of a test.
        system: "si", "metric" or "us".

    Returns:
        A figure of two axes.

    Raises:
        InputError: an unknown system.
    """
    units = unit_system(system)
    pressure_unit, force_unit = units["pressure"], units["force"]
    N, Pa = factor(force_unit, "force"), factor(pressure_unit, "pressure")
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    muscle, record = found.characterisation, found.record
    shades = np.linspace(0.15, 0.9, len(muscle.isobars))
    for shade, bar in zip(shades, muscle.isobars, strict=True):
        contraction = (muscle.rest_length - bar.length) / muscle.rest_length
        colour = (0.1, 0.25, float(shade))
        left.plot(contraction, bar.shortening / N, color=colour, lw=1.2)
        left.plot(contraction, bar.lengthening / N, color=colour, lw=1.2, ls="--")
        label = f"{bar.set_pressure / Pa:.4g}"
        left.annotate(label, (contraction[0], bar.lengthening[0] / N), fontsize=7)
    left.set_xlabel("contraction (L0 - L)/L0")
    left.set_ylabel(f"force [{force_unit}]")
    left.set_title(
        f"shortening (solid), lengthening (dashed); set pressure [{pressure_unit}]", fontsize=9
    )
    held = np.isfinite(record.set_pressure)
    step = max(1, int(held.sum()) // _MOST_POINTS)
    error = (record.pressure - record.set_pressure)[held][::step] / Pa
    right.plot(record.time[held][::step], error, lw=0.5, color=(0.1, 0.25, 0.5))
    strokes = [bar.largest_pressure_error for bar in muscle.isobars]
    right.set_ylim(-1.5 * max(strokes) / Pa, 1.5 * max(strokes) / Pa)
    right.axhline(0, color="k", lw=0.5)
    right.set_xlabel("time [s]")
    right.set_ylabel(f"pressure - set pressure [{pressure_unit}]")
    right.set_title("pressure held (new set pressures run off the axis)", fontsize=9)
    return figure
