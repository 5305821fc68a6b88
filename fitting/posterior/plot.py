"""The picture of a posterior: every pair of parameters, and the ranks of each chain."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from famjax.boundary.units import factor, unit_system

from .result import Posterior

_BINS = 20
_POINTS = 800  # of each pair: more only cover one another
_COLOURS = ("#1f4e79", "#d1793b", "#4b8b6f", "#8a5a9e", "#a33b3b", "#6f6f6f")


def plot_posterior(posterior: Posterior, system: str = "metric") -> Figure:
    """Pairs below the diagonal, distributions on it, and ranks of each chain to the right.

    Ranks of chains that agree are uniform: every bar is near the line.

    Args:
        posterior: from `sample`.
        system: "si", "metric" or "us".

    Returns:
        A figure, not shown; save it with `savefig`.

    References:
        Vehtari et al. 2021 (rank plots).
    """
    count = len(posterior.names)
    size = max(6.5, 1.25 * count)
    figure = Figure(figsize=(1.35 * size + 1.2, size))
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        count, count + 3, width_ratios=[1] * count + [0.35, 1.4, 1.4], left=0.075, right=0.99,
        bottom=0.085, top=0.92, wspace=0.12, hspace=0.14,
    )  # fmt: skip
    units = [unit_system(system)[kind] for kind in posterior.kinds]
    values = [
        posterior.draws(name) / factor(unit, kind)
        for name, unit, kind in zip(posterior.names, units, posterior.kinds, strict=True)
    ]
    labels = [
        f"{_short(name)}\n{unit}" if unit else _short(name)
        for name, unit in zip(posterior.names, units, strict=True)
    ]
    for row in range(count):
        for column in range(row + 1):
            axes = figure.add_subplot(grid[row, column])
            if row == column:
                axes.hist(values[row].ravel(), 40, color=_COLOURS[0], alpha=0.8)
                axes.set_yticks([])
            else:
                _draw_pair(axes, values[column], values[row], posterior.divergent)
            axes.xaxis.set_major_locator(MaxNLocator(2))
            axes.yaxis.set_major_locator(MaxNLocator(2))
            axes.tick_params(labelsize=6, labelbottom=row == count - 1, labelleft=0 == column < row)
            axes.set_xlim(values[column].min(), values[column].max())
            if row == count - 1:
                axes.set_xlabel(labels[column], fontsize=7)
            if column == 0 and row:
                axes.set_ylabel(labels[row], fontsize=7)
        _draw_ranks(
            figure.add_subplot(grid[row, count + 1 :]), values[row], labels[row], row, count
        )
    figure.suptitle(
        f"{posterior.name}: posterior of {posterior.samples.shape[0]} chains, R-hat at most "
        f"{posterior.r_hat:.3f}, effective size at least {posterior.effective_size:.0f}",
        fontsize=11,
    )
    return figure


def _short(name: str) -> str:
    return name.replace("_", " ", 1)


def _draw_pair(axes: Axes, x: np.ndarray, y: np.ndarray, divergent: np.ndarray) -> None:
    thin = slice(None, None, max(1, x.size // _POINTS))
    axes.plot(x.ravel()[thin], y.ravel()[thin], ".", ms=1.6, color=_COLOURS[0], alpha=0.5)
    axes.plot(x[divergent], y[divergent], "x", ms=4, color="#c02020")
    axes.set_ylim(y.min(), y.max())


def _draw_ranks(axes: Axes, values: np.ndarray, label: str, row: int, count: int) -> None:
    from scipy.stats import rankdata  # noqa: PLC0415 -- as in diagnostics

    ranks = rankdata(values).reshape(values.shape) / values.size
    expected = values.shape[1] / _BINS
    for chain, of_chain in enumerate(ranks):
        heights, edges = np.histogram(of_chain, _BINS, (0, 1))
        colour = _COLOURS[chain % len(_COLOURS)]
        axes.stairs(heights / expected, edges, color=colour, lw=0.9, label=f"chain {chain + 1}")
    axes.axhline(1, color="0.5", lw=0.6)
    axes.set_ylim(0, 2.2)
    axes.set_xlim(0, 1)
    axes.tick_params(labelsize=6, labelbottom=row == count - 1)
    axes.text(0.01, 0.97, label.partition("\n")[0], transform=axes.transAxes, fontsize=7, va="top")
    if row == 0:
        axes.set_title("ranks of each chain, 1 is uniform", fontsize=8)
    if row == count - 1:
        axes.set_xlabel("rank of the draw", fontsize=7)
