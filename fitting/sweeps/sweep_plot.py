"""Pictures of a sweep: errors by order, form and constraint, and the force curves of some fits."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from famjax.boundary.units import factor, unit_system

from .result import Sweep, SweepRow

_COLOURS = {"none": "C0", "positive": "C3", "slope": "C1", "drucker": "C2"}
_SHADES = mpl.colormaps["viridis"]
_LENGTHS = 120
_ABOVE = 1.0  # of panels: where titles come to lie; not to seek a place for them saves a tenth
_TOP = 1.07  # times what is largest, to which an axis reaches
_NAMED = 8  # isobars in a legend at most; their colours go by the pressure


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
    orders = sorted({row.order for row in rows})
    panels = (
        ("rmse", f"mean RMSE, {unit}", force),
        ("mae", f"mean MAE, {unit}", force),
        ("blocked_error", f"blocked force error, {unit}", force),
        ("free_contraction_error", "free contraction error", 1.0),
    )
    # One panel for each error, in which the forms stand side by side: it is drawn in half the time that
    # a panel for each of them takes.
    figure, axes = _panels(len(panels), 1, (3.4 * len(forms), 2.25), top=0.75, sharey=False)
    at = [[k * (len(orders) + 1) + n for n in range(len(orders))] for k in range(len(forms))]
    places = dict(zip(forms, (dict(zip(orders, one, strict=True)) for one in at), strict=True))
    for one, (name, label, scale) in zip(axes[:, 0], panels, strict=True):
        _draw_by_order(one, rows, places, name, scale)
        one.set(ylabel=label, ylim=(0, _TOP * _largest(rows, name, scale)))
    last = axes[-1, 0]
    last.set_xticks([x for of in at for x in of], orders * len(forms))
    last.set(xlabel="order of the law", xlim=(-0.6, at[-1][-1] + 0.6))
    for form, of in zip(forms, at, strict=True):
        axes[0, 0].text(
            (of[0] + of[-1]) / 2, 1.03, f"{form} in pressure", ha="center", fontsize=10,
            transform=axes[0, 0].get_xaxis_transform(),
        )  # fmt: skip
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
    at = [readings.loaded & (readings.pressures.level == level) for level in levels]
    measured = np.concatenate([np.flatnonzero(of) for of in at])
    spots = (1 - readings.length / readings.specimen.rest_length)[measured]
    colours = np.repeat(shades, [of.sum() for of in at], axis=0)
    for one, row in zip(axes, chosen, strict=True):
        F = [braid[k] + bladder[k, :, : E.size] @ E for k, E in enumerate(row.coefficients)]
        curves = np.stack([contraction, np.array(F) / force], axis=-1)
        one.add_collection(LineCollection(list(curves), colors=shades, lw=1))
        one.scatter(spots, readings.force[measured] / force, s=4, c=colours, lw=0)
        name = f"{row.dependence}, order {row.order}, {row.constraint}"
        error = f"RMSE {row.rmse / force:.3g} {units['force']}"
        one.set_title(f"{name}\n{error}", fontsize=9, y=_ABOVE)
        one.set(xlabel="contraction")
    axes[0].set(
        ylabel=f"force, {units['force']}",
        ylim=(0, _TOP * float(readings.force[measured].max()) / force),
    )
    named = np.unique(np.linspace(0, levels.size - 1, _NAMED).round().astype(int))[::-1]
    axes[0].legend(
        [Line2D([], [], color=tuple(shades[k])) for k in named],
        [f"{levels[k] / pressure:.4g} {units['pressure']}" for k in named],
        frameon=False, fontsize=7,
    )  # fmt: skip
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


def _draw_by_order(
    axes: Axes, rows: list[SweepRow], places: dict[str, dict[int, int]], name: str, scale: float
) -> None:
    """Lines over the orders, one for each constraint and form; without a fit there is a gap."""
    named = set()
    for form, of in places.items():
        for constraint in dict.fromkeys(row.constraint for row in rows):
            same = [r for r in rows if (r.dependence, r.constraint) == (form, constraint)]
            axes.plot(
                [of[row.order] for row in same],
                [getattr(row, name) / scale for row in same],
                "o-",
                ms=3.5,
                lw=1,
                color=_COLOURS[constraint],
                label=None if constraint in named else constraint,
            )
            named.add(constraint)
        known = {r.order for r in rows if r.dependence == form and np.isfinite(getattr(r, name))}
        for order in of.keys() - known:
            axes.text(of[order], 0.05, "no fit", ha="center", fontsize=7, color="0.4",
                      transform=axes.get_xaxis_transform())  # fmt: skip
    axes.spines[["top", "right"]].set_visible(False)


def _largest(rows: list[SweepRow], name: str, scale: float) -> float:
    """The largest error of all rows; 1 where there is none."""
    known = [getattr(row, name) / scale for row in rows if np.isfinite(getattr(row, name))]
    return max(known, default=0.0) or 1.0


def _isobars(found: Sweep, data: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contractions from rest to the shortest reading, braid forces [N] and columns [N/Pa] there."""
    model, readings, levels = found.models[data], found.data[data], found.pressures[data]
    loaded = readings.loaded
    shortest = [readings.length[loaded & (readings.pressures.level == P)].min() for P in levels]
    length = np.linspace(model.rest_length, shortest, _LENGTHS, axis=1)
    return 1 - length / model.rest_length, *model.columns(length, levels[:, None])
