"""Pictures of a sweep: errors by order, form and constraint, and the force curves of some fits."""

import matplotlib as mpl
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from famjax.boundary.units import factor, unit_system

from .sweeps import Sweep, SweepRow

_COLOURS = {"none": "C0", "positive": "C3", "slope": "C1", "drucker": "C2"}
_LENGTHS = 120
_TOP = 1.07  # times what is largest, to which an axis reaches
_NAMED = 8  # isobars in a legend at most; their colours go by the pressure


def plot_errors(found: Sweep, system: str = "metric", data: int = 0) -> Figure:
    """RMSE, MAE, blocked force and free contraction against the order, the forms side by side.

    Args:
        found: the sweep.
        system: "si", "metric" or "us".
        data: index of the force map.

    Returns:
        A figure, not shown; save it with `savefig`. Without a fit there is a gap.

    References:
        Chambers 2021, figures 7.2 to 7.5.
    """
    unit = unit_system(system)["force"]
    force, rows = factor(unit, "force"), rows_of(found, data)
    forms = list(dict.fromkeys(row.dependence for row in rows))
    orders = sorted({row.order for row in rows})
    wide = len(orders) + 1
    figure = Figure(figsize=(0.8 + 3.2 * len(forms), 8.5), layout="constrained")
    axes = figure.subplots(4, sharex=True)
    panels = (
        ("rmse", f"mean RMSE, {unit}", force),
        ("mae", f"mean MAE, {unit}", force),
        ("blocked_error", f"blocked force error, {unit}", force),
        ("free_contraction_error", "free contraction error", 1.0),
    )
    for one, (name, label, scale) in zip(axes, panels, strict=True):
        for k, form in enumerate(forms):
            for constraint in dict.fromkeys(row.constraint for row in rows):
                same = [r for r in rows if (r.dependence, r.constraint) == (form, constraint)]
                one.plot(
                    [k * wide + orders.index(row.order) for row in same],
                    [getattr(row, name) / scale for row in same],
                    "o-", ms=3.5, lw=1, color=_COLOURS[constraint],
                    label=None if k else constraint,
                )  # fmt: skip
        largest = np.nanmax([getattr(row, name) / scale for row in rows] + [1e-9])
        one.set(ylabel=label, ylim=(0, _TOP * largest))
        one.spines[["top", "right"]].set_visible(False)
    places = [k * wide + n for k in range(len(forms)) for n in range(len(orders))]
    axes[-1].set_xticks(places, orders * len(forms))
    axes[-1].set_xlabel(f"order of the law; {', then '.join(forms)} in pressure")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
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
    units, readings, levels = unit_system(system), found.data[data], found.pressures[data]
    force, pressure = factor(units["force"], "force"), factor(units["pressure"], "pressure")
    muscle, loaded = found.muscles[data], readings.loaded
    rest, at_level = muscle.rest_length, np.searchsorted(levels, readings.pressures.level[loaded])
    shortest = [readings.length[loaded][at_level == k].min() for k in range(levels.size)]
    length = np.linspace(rest, shortest, _LENGTHS, axis=1)
    braid, bladder = muscle.columns(length, levels[:, None])
    shades = mpl.colormaps["viridis"](np.linspace(0, 0.9, levels.size))
    figure = Figure(figsize=(3.8 * len(chosen), 3.9), layout="constrained")
    axes = figure.subplots(1, len(chosen), squeeze=False, sharey=True)[0]
    for one, row in zip(axes, chosen, strict=True):
        F = braid + (bladder[..., : row.order] @ row.coefficients[..., None])[..., 0]
        curves = np.stack([1 - length / rest, F / force], axis=-1)
        one.add_collection(LineCollection(list(curves), colors=shades, lw=1))
        spots = 1 - readings.length[loaded] / rest, readings.force[loaded] / force
        one.scatter(*spots, s=4, c=shades[at_level], lw=0)
        one.set_title(
            f"{row.dependence}, order {row.order}, {row.constraint}\n"
            f"RMSE {row.rmse / force:.3g} {units['force']}", fontsize=9,
        )  # fmt: skip
        one.set(xlabel="contraction")
    top = _TOP * float(readings.force[loaded].max()) / force
    axes[0].set(ylabel=f"force, {units['force']}", ylim=(0, top))
    for k in np.unique(np.linspace(0, levels.size - 1, _NAMED).round().astype(int))[::-1]:
        label = f"{levels[k] / pressure:.4g} {units['pressure']}"
        axes[0].plot([], [], color=shades[k], label=label)
    axes[0].legend(frameon=False, fontsize=7)
    return figure


def rows_of(found: Sweep, data: int) -> list[SweepRow]:
    """The rows of one force map."""
    each = len(found.rows) // len(found.data)
    return list(found.rows[data * each : (data + 1) * each])
