"""Pictures of a campaign: profiles against contraction, length and diameter over time, quality."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from famjax.boundary.units import factor, unit_system
from imaging import QualityLimits, Table

_PROFILES = 40  # drawn at most, evenly over the contraction
_MARGINS = {"left": 0.07, "right": 0.98, "top": 0.95, "bottom": 0.07, "wspace": 0.25, "hspace": 0.3}
"""Of the four axes: a layout by matplotlib's solver costs as much time as all else of the figure."""
_COLOURS = mpl.colormaps["viridis"]
_QUALITY = (
    "blur_px", "tape_sd_px", "residual_rms", "outlier_fraction", "misfit", "kappa", "axis_kink",
    "saturated",
)  # fmt: skip
"""Quality figures drawn: those that have a largest value."""


def plot_table(table: Table, system: str = "us", limits: QualityLimits | None = None) -> Figure:
    """Profiles coloured by contraction, length and mean diameter over time, and quality.

    Of one picture there is the profile and the quality. Where the braid angle was measured, its
    profiles are there, too, with the error's band of a single picture, and its mean over time.

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
    braided = "braid_angle_deg" in table.columns
    if len(table) == 1:
        figure = Figure(figsize=(16.5 if braided else 11, 4))
        profiles, quality, *angles = figure.subplots(
            1, 3 if braided else 2, gridspec_kw=_MARGINS | {"top": 0.9, "bottom": 0.14}
        )
    else:
        figure = Figure(figsize=(11, 12 if braided else 8))
        (profiles, length), (quality, diameter), *more = figure.subplots(
            3 if braided else 2, 2, gridspec_kw=_MARGINS
        )
        _draw_over_time(length, table, "length", unit, per_unit)
        _draw_over_time(diameter, table, "mean_diameter", unit, per_unit)
        angles = [axes for row in more for axes in row]
    if angles:
        _draw_angles(angles[0], table, unit, per_unit)
    if len(angles) > 1:
        _draw_over_time(angles[1], table, "braid_angle_deg", "deg", 1.0)
    FigureCanvasAgg(figure)
    _draw_profiles(figure, profiles, table, unit, per_unit)
    _draw_quality(quality, table, limits or QualityLimits())
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_profiles(figure: Figure, axes: Axes, table: Table, unit: str, per_unit: float) -> None:
    axes.set(xlabel=f"z, {unit}", ylabel=f"D, {unit}", title="profiles")
    if not table.ok.any():
        axes.text(0.5, 0.5, "no picture was measured", transform=axes.transAxes, ha="center")
        return
    span = _draw_lines(axes, table, table.diameter / per_unit, per_unit)
    if len(table) > 1:
        figure.colorbar(ScalarMappable(span, _COLOURS), ax=axes, label="contraction")


def _draw_angles(axes: Axes, table: Table, unit: str, per_unit: float) -> None:
    axes.set(xlabel=f"z, {unit}", ylabel="braid angle, deg", title="braid angle")
    _draw_lines(axes, table, table.braid_angle, per_unit)
    if len(table) == 1:
        z = table.position * table["length"][0] / per_unit
        angle, stderr = table.braid_angle[0], table.braid_angle_stderr[0]
        axes.fill_between(z, angle - 2 * stderr, angle + 2 * stderr, alpha=0.3, lw=0)


def _draw_lines(axes: Axes, table: Table, profiles: np.ndarray, per_unit: float) -> Normalize:
    """Profiles over z, coloured by contraction."""
    good = np.flatnonzero(table.ok)
    contraction = table["contraction"]
    ordered = good[np.argsort(contraction[good])]
    chosen = ordered[np.linspace(0, len(ordered) - 1, min(len(ordered), _PROFILES)).astype(int)]
    span = Normalize(float(contraction[good].min()), float(contraction[good].max()) + 1e-9)
    for k in chosen:
        z = table.position * table["length"][k]
        axes.plot(z / per_unit, profiles[k], color=_COLOURS(span(contraction[k])), lw=0.8)
    return span


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
