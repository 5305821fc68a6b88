"""Pictures of a sweep: errors by order, form and constraint, and the force curves of some fits."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from famjax.boundary.units import factor, unit_system

from .result import Sweep, SweepRow

_COLOURS = {"none": "C0", "positive": "C3", "slope": "C1", "drucker": "C2"}
_SHADES = mpl.colormaps["viridis"]
_LENGTHS = 120
_ABOVE = 1.0  # of panels: where titles come to lie; not to seek a place for them saves a tenth


def plot_errors(found: Sweep, system: str = "metric", data: int = 0) -> Figure:
    """RMSE, MAE, blocked force and free contraction against the order, one column for each form.

    Args:
        found: the sweep.
        system: "si", "metric" or "us".
        data: index of the force map.

    Returns:
        A figure, not shown; save it with `savefig`.

    References:
        Chambers 2021, figures 7.2 to 7.5.
    """
    unit = unit_system(system)["force"]
    force = factor(unit, "force")
    rows = rows_of(found, data)
    forms = list(dict.fromkeys(row.dependence for row in rows))
    panels = (
        ("rmse", f"mean RMSE, {unit}", force),
        ("mae", f"mean MAE, {unit}", force),
        ("blocked_error", f"blocked force error, {unit}", force),
        ("free_contraction_error", "free contraction error", 1.0),
    )
    figure, axes = _panels(len(panels), len(forms), (3.4, 2.25), top=0.75, sharey="row")
    for line, (name, label, scale) in zip(axes, panels, strict=True):
        for one, form in zip(line, forms, strict=True):
            _draw_by_order(one, [r for r in rows if r.dependence == form], name, scale)
        line[0].set(ylabel=label, ylim=(0, None))
    for one, form in zip(axes[0], forms, strict=True):
        one.set_title(f"{form} in pressure", fontsize=10, y=_ABOVE)
    for one in axes[-1]:
        one.set(xlabel="order of the law")
    axes[0, 0].set_xticks(sorted({row.order for row in rows}))  # of all panels, which share them
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=4, frameon=False)
    return figure


def plot_curves(
    found: Sweep, chosen: list[SweepRow], system: str = "metric", data: int = 0
) -> Figure:
    """Measured and fitted isobars of some fits, one panel for each.

    Args:
        found: the sweep.
        chosen: some of its rows, of that force map.
        system: "si", "metric" or "us".
        data: index of the force map.

    Returns:
        A figure, not shown; save it with `savefig`.

    References:
        Chambers 2021, figures 7.6 to 7.10.
    """
    units, readings = unit_system(system), found.data[data]
    force, pressure = factor(units["force"], "force"), factor(units["pressure"], "pressure")
    figure, (axes,) = _panels(1, len(chosen), (3.8, 3.9), top=0.5, sharey="row")
    levels = found.pressures[data]
    shades = _SHADES(np.linspace(0, 0.9, levels.size))
    contraction, braid, bladder = _isobars(found, data)
    for one, row in zip(axes, chosen, strict=True):
        for k, (level, E, shade) in enumerate(zip(levels, row.coefficients, shades, strict=True)):
            at = readings.loaded & (readings.pressures.level == level)
            one.plot(
                1 - readings.length[at] / readings.specimen.rest_length,
                readings.force[at] / force,
                ".",
                color=shade,
                ms=2,
            )
            label = f"{level / pressure:.4g} {units['pressure']}"
            F = braid[k] + bladder[k, :, : E.size] @ E
            one.plot(contraction[k], F / force, color=shade, lw=1, label=label)
        name = f"{row.dependence}, order {row.order}, {row.constraint}"
        error = f"RMSE {row.rmse / force:.3g} {units['force']}"
        one.set_title(f"{name}\n{error}", fontsize=9, y=_ABOVE)
        one.set(xlabel="contraction", ylim=(0, None))
    axes[0].set(ylabel=f"force, {units['force']}")
    axes[0].legend(frameon=False, fontsize=7, ncols=2)
    return figure


def rows_of(found: Sweep, data: int) -> list[SweepRow]:
    """The rows of one force map."""
    each = len(found.rows) // len(found.data)
    return list(found.rows[data * each : (data + 1) * each])


def _panels(
    lines: int, columns: int, size: tuple[float, float], *, top: float, sharey: Any
) -> tuple[Figure, np.ndarray]:
    """A figure of panels, each of a size [inch], with fixed margins and one of `top` [inch].

    A layout that fits the margins to the text takes as long as the picture itself.
    """
    width, height = columns * size[0], lines * size[1]
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    axes = figure.subplots(lines, columns, squeeze=False, sharex=lines > 1, sharey=sharey)
    figure.subplots_adjust(
        left=0.75 / width, right=1 - 0.1 / width, bottom=0.5 / height, top=1 - top / height,
        wspace=0.08, hspace=0.1,
    )  # fmt: skip
    return figure, axes


def _draw_by_order(axes: Axes, rows: list[SweepRow], name: str, scale: float) -> None:
    for constraint in dict.fromkeys(row.constraint for row in rows):
        same = [row for row in rows if row.constraint == constraint]
        axes.plot(
            [row.order for row in same],
            [getattr(row, name) / scale for row in same],
            "o-",
            ms=3.5,
            lw=1,
            color=_COLOURS[constraint],
            label=constraint,
        )
    axes.spines[["top", "right"]].set_visible(False)


def _isobars(found: Sweep, data: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contractions from rest to the shortest reading, braid forces [N] and columns [N/Pa] there."""
    model, readings, levels = found.models[data], found.data[data], found.pressures[data]
    loaded = readings.loaded
    shortest = [readings.length[loaded & (readings.pressures.level == P)].min() for P in levels]
    length = np.linspace(model.rest_length, shortest, _LENGTHS, axis=1)
    return 1 - length / model.rest_length, *model.columns(length, levels[:, None])
