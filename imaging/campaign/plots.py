"""Pictures of a campaign: profiles against contraction, length and diameter over time, quality."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from famjax.boundary.units import factor, unit_system

from ..quality import QualityLimits
from .table import Table

_PROFILES = 40  # drawn at most, evenly over the contraction
_MARGINS = {"left": 0.07, "right": 0.98, "top": 0.95, "bottom": 0.07, "wspace": 0.25, "hspace": 0.3}
"""Of the four axes: a layout by matplotlib's solver costs as much time as all else of the figure."""
_QUALITY = (
    "blur_px", "tape_sd_px", "residual_rms", "outlier_fraction", "misfit", "kappa", "axis_kink",
    "saturated",
)  # fmt: skip
"""Quality figures drawn: those that have a largest value."""


def plot_table(table: Table, system: str = "us", limits: QualityLimits | None = None) -> Figure:
    """Profiles coloured by contraction, length and mean diameter over time, and quality.

    Of one picture there is the profile and the quality.

    Args:
        table: of a campaign.
        system: "us", "metric" or "si".
        limits: of the recipe, over which the quality is drawn; the usual ones if None.

    Returns:
        A figure, not shown; save it with `savefig`. Pictures that failed are marked below the
        quality.
    """
    unit = unit_system(system)["length"]
    per_unit = factor(unit, "length")
    if len(table) == 1:
        figure = Figure(figsize=(11, 4))
        profiles, quality = figure.subplots(
            1, 2, gridspec_kw=_MARGINS | {"top": 0.9, "bottom": 0.14}
        )
    else:
        figure = Figure(figsize=(11, 8))
        (profiles, length), (quality, diameter) = figure.subplots(2, 2, gridspec_kw=_MARGINS)
        _draw_over_time(length, table, "length", unit, per_unit)
        _draw_over_time(diameter, table, "mean_diameter", unit, per_unit)
    FigureCanvasAgg(figure)
    _draw_profiles(figure, profiles, table, unit, per_unit)
    _draw_quality(quality, table, limits or QualityLimits())
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_profiles(figure: Figure, axes: Axes, table: Table, unit: str, per_unit: float) -> None:
    good = np.flatnonzero(table.ok)
    axes.set(xlabel=f"z, {unit}", ylabel=f"D, {unit}", title="profiles")
    if not len(good):
        axes.text(0.5, 0.5, "no picture was measured", transform=axes.transAxes, ha="center")
        return
    contraction = table["contraction"]
    ordered = good[np.argsort(contraction[good])]
    chosen = ordered[np.linspace(0, len(ordered) - 1, min(len(ordered), _PROFILES)).astype(int)]
    colours = mpl.colormaps["viridis"]
    span = Normalize(float(contraction[good].min()), float(contraction[good].max()) + 1e-9)
    for k in chosen:
        z = table.position * table["length"][k]
        colour = colours(span(contraction[k]))
        axes.plot(z / per_unit, table.diameter[k] / per_unit, color=colour, lw=0.8)
    if len(table) > 1:
        figure.colorbar(ScalarMappable(span, colours), ax=axes, label="contraction")


def _draw_over_time(axes: Axes, table: Table, name: str, unit: str, per_unit: float) -> None:
    axes.set(title=name.replace("_", " "), ylabel=unit)
    stamped = table.ok.any() and np.isfinite(table["time"][table.ok]).all()
    axes.set(xlabel="time, s" if stamped else "picture")
    if name not in table.columns:
        return
    at = table["time"] if stamped else np.arange(len(table))
    spread = table[f"{name}_stderr"] / per_unit
    axes.errorbar(at, table[name] / per_unit, spread, fmt=".", ms=3, lw=0.6, color="C0")


def _draw_quality(axes: Axes, table: Table, limits: QualityLimits) -> None:
    axes.set(title="quality, each figure over its limit", xlabel="picture", ylim=(0, 1))
    for name in _QUALITY:
        if name in table.columns and np.isfinite(table[name]).any():
            over = table[name] / getattr(limits, name)
            axes.plot(np.arange(len(table)), over, ".-", lw=0.6, ms=2, label=name.replace("_", " "))
    failed = np.flatnonzero(~table.ok)
    if len(failed):
        axes.plot(failed, np.zeros(len(failed)), "x", color="C3", label="failed", clip_on=False)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(frameon=False, fontsize=8)
