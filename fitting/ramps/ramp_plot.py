"""The picture of a set of raw records: readings, quasi-static points, branches and hysteresis."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from famjax.boundary.units import factor, unit_system

from .force_map import StaticMap
from .quasi_static_ramp import QuasiStatic

_COLOURS = mpl.colormaps["viridis"]
_MOST_DRAWN = 4000  # readings of a record; more are thinned


def plot_ramps(static: StaticMap, system: str = "metric") -> Figure:
    """The figure of a record set and of the static map made from it.

    Args:
        static: what `static_map` returned.
        system: "si", "metric" or "us".

    Returns:
        A figure, not shown; save it with `savefig`.
    """
    figure = Figure(figsize=(11, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplot_mosaic([["pressure", "branches"], ["force", "hysteresis"]])
    lengths = [one.length for one in static.lengths]
    colours = dict(zip(lengths, _COLOURS(np.linspace(0.0, 0.85, len(lengths))), strict=True))
    axes["force"].sharex(axes["pressure"])
    _draw_raw(axes["pressure"], axes["force"], static.points, colours, system)
    _draw_branches(axes["branches"], static, colours, system)
    _draw_hysteresis(axes["hysteresis"], static, colours, system)
    unit = unit_system(system)["length"]
    for length, colour in colours.items():
        axes["branches"].plot(
            [], [], color=colour, label=f"{length / factor(unit, 'length'):.5g} {unit}"
        )
    axes["branches"].legend(frameon=False, fontsize=8)
    points = static.points
    figure.suptitle(
        f"{len(points.records)} records, {points.force.size} quasi-static points, "
        f"{int(points.slack.sum())} of them slack",
        fontsize=11,
    )
    return figure


def _draw_raw(top: Axes, bottom: Axes, points: QuasiStatic, colours: dict, system: str) -> None:
    pressure, force = (factor(unit_system(system)[kind], kind) for kind in ("pressure", "force"))
    for number, record in enumerate(points.records):
        rows = slice(None, None, -(-record.time.size // _MOST_DRAWN))
        style = {"color": colours[record.length], "lw": 0.4, "alpha": 0.5}
        gauge = record.pressure - points.atmosphere[number]
        top.plot(record.time[rows], gauge[rows] / pressure, **style)
        bottom.plot(record.time[rows], record.force[rows] / force, **style)
        mine = points.record == number
        dots = {"color": colours[record.length], "ls": "", "marker": ".", "ms": 3}
        top.plot(points.time[mine], points.pressure[mine] / pressure, **dots)
        bottom.plot(points.time[mine], points.force[mine] / force, **dots)
    bottom.axhline(points.slack_below / force, color="0.6", lw=0.8, ls=":")
    top.set(ylabel=f"gauge pressure, {unit_system(system)['pressure']}")
    bottom.set(xlabel="time, s", ylabel=f"force, {unit_system(system)['force']}")
    top.set_title("readings; dots: points", fontsize=9)
    bottom.set_title("dotted: slack below", fontsize=9)


def _draw_branches(axes: Axes, static: StaticMap, colours: dict, system: str) -> None:
    points = static.points
    pressure, force = (factor(unit_system(system)[kind], kind) for kind in ("pressure", "force"))
    for length, colour in colours.items():
        for filling, marker in ((True, "^"), (False, "v")):
            mine = (points.length == length) & (points.filling == filling) & ~points.slack
            axes.plot(
                points.pressure[mine] / pressure,
                points.force[mine] / force,
                marker=marker,
                ls="",
                ms=3,
                mfc="none",
                color=colour,
            )
        rows = (static.length == length) & ~static.slack
        axes.plot(static.pressure[rows] / pressure, static.force[rows] / force, color=colour, lw=1)
    axes.plot(
        points.pressure[points.slack] / pressure,
        points.force[points.slack] / force,
        "x",
        color="0.7",
        ms=3,
    )
    units = unit_system(system)
    axes.set(xlabel=f"gauge pressure, {units['pressure']}", ylabel=f"force, {units['force']}")
    axes.set_title("triangles: fill up, vent down; crosses: slack; line: map", fontsize=9)


def _draw_hysteresis(axes: Axes, static: StaticMap, colours: dict, system: str) -> None:
    pressure, force = (factor(unit_system(system)[kind], kind) for kind in ("pressure", "force"))
    axes.axhline(0, color="0.7", lw=0.8)
    for length, colour in colours.items():
        rows = (static.length == length) & ~static.slack & np.isfinite(static.half_width)
        axes.errorbar(
            static.pressure[rows] / pressure,
            static.half_width[rows] / force,
            yerr=static.force_std[rows] / force,
            color=colour,
            marker=".",
            lw=1,
            elinewidth=0.6,
        )
    units = unit_system(system)
    axes.set(
        xlabel=f"gauge pressure, {units['pressure']}",
        ylabel=f"(vent - fill)/2, {units['force']}",
    )
    axes.set_title("hysteresis half-width; bars: standard error of the map", fontsize=9)
