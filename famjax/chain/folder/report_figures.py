"""Figures of the report of a folder that no step draws."""

import io

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from famjax.boundary.units import factor, unit_system
from fitting.shapes import Pictures

from .evaluation import PICTURES, measured_surface
from .sheet import RESULTS, Sheet

_SHOWN = 5  # profiles


def svg(figure: Figure) -> str:
    """The figure as SVG, the same bytes every time."""
    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "famjax"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def profile_figure(sheet: Sheet, system: str) -> Figure:
    """Profiles at five contractions with their bands; the mean diameter over the contraction."""
    surface = measured_surface(sheet)
    unit = unit_system(system)["length"]
    scale, rest = factor(unit, "length"), sheet.specimen.rest_length
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    x = np.linspace(0, 1, surface.diameters.shape[-1])
    chosen = np.linspace(0, len(surface.lengths) - 1, _SHOWN).round().astype(int)
    for shade, k in zip(np.linspace(0.15, 0.85, _SHOWN), chosen, strict=True):
        colour, L = (0.1, 0.3, float(shade)), float(surface.lengths[k])
        low, high = np.quantile(surface.draws[:, 0, k], [0.025, 0.975], axis=0)
        left.fill_between(x * L / scale, low / scale, high / scale, color=colour, alpha=0.3, lw=0)
        left.plot(
            x * L / scale, surface.diameters[0, k] / scale, color=colour, lw=1.2,
            label=f"{100 * (1 - L / rest):.1f} %",
        )  # fmt: skip
    left.set(xlabel=f"z [{unit}]", ylabel=f"diameter [{unit}]", title="profiles by contraction")
    left.legend(fontsize=8)
    pictures = Pictures.of(sheet.folder / RESULTS / PICTURES / "measurements.nc")
    contraction = 1 - pictures.length / rest
    right.plot(contraction, pictures.diameter.mean(axis=1) / scale, ".", color="0.5", ms=4)
    mean = surface.diameters[0].mean(axis=1) / scale
    right.plot(1 - surface.lengths / rest, mean, color=(0.1, 0.3, 0.6), lw=1.2)
    right.set(
        xlabel="contraction",
        ylabel=f"mean diameter [{unit}]",
        title="every picture, and the surface",
    )
    return figure
