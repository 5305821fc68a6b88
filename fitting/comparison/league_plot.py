"""The picture of a comparison: one line per model, its errors in sample and on held-out readings."""

import math

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .league_table import Comparison

_SERIES = (
    ("rmse", "all readings fitted", "o", "C0"),
    ("lopo_rmse", "each pressure left out", "d", "C2"),
    ("lolo_interior_rmse", "each inner length left out", "s", "C1"),
    ("lolo_rmse", "each length left out", "|", "0.5"),
)
_WIDTH = 9.0  # inch


def plot_comparison(comparison: Comparison) -> Figure:
    """The figure of a league table, the best model on top, errors on a logarithmic axis.

    Args:
        comparison: what `compare` returned.

    Returns:
        A figure, not shown; save it with `savefig`.
    """
    rows = [row for row in comparison.rows if math.isfinite(row.rmse)]
    width, height = _WIDTH, 1.6 + 0.27 * len(rows)
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    data, places = comparison.data, range(len(rows))
    limit = data.max_force
    for place in places:
        axes.axhline(place, color="0.93", lw=0.8, zorder=0)
    for key, label, marker, colour in _SERIES:
        values = [getattr(row, key) for row in rows]
        shown = [min(value, limit) if math.isfinite(value) else math.nan for value in values]
        axes.plot(shown, places, marker, color=colour, ms=6, label=label)
    axes.axvline(limit, color="0.8", lw=0.8, ls="--")
    axes.set(
        xscale="log",
        xlabel="root mean square error, N (dashed: the largest force, and beyond)",
        ylim=(len(rows) - 0.5, -0.5),
    )
    axes.set_yticks(
        list(places),
        [f"{row.label} [{row.n_parameters}]{' *' if row.at_bound else ''}" for row in rows],
        fontsize=8,
    )
    figure.legend(frameon=False, fontsize=8, ncols=len(_SERIES), loc="lower center")
    axes.set_title(
        f"{data.specimen.name}: {int(data.loaded.sum())} loaded readings, up to "
        f"{data.max_force:.4g} N\n[parameters], * at a bound",
        fontsize=10,
    )
    # A layout that fits the margins to the text draws the picture twice; one margin depends on it.
    names = max((one.get_window_extent().width for one in axes.get_yticklabels()), default=0.0)
    figure.subplots_adjust(
        left=(names / figure.dpi + 0.15) / width, right=1 - 0.1 / width,
        bottom=0.75 / height, top=1 - 0.5 / height,
    )  # fmt: skip
    return figure
