"""Figures for the report: each function returns a figure and its caption, or None if data are missing."""

import glob
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitting.report import plot_law

from ..evaluation import CYLINDER, GEOMETRIES, PICTURES
from .source import PARTS, Source

Drawn = tuple[Figure, str] | None
"""A figure and its caption; None if the folder does not contain the data."""

STYLE: dict[Any, Any] = {
    "font.size": 8, "axes.titlesize": 8, "legend.fontsize": 7, "axes.linewidth": 0.6,
    "lines.linewidth": 1.1, "axes.spines.top": False, "axes.spines.right": False,
    "legend.frameon": False, "svg.fonttype": "path",
}  # fmt: skip
LINES = dict(zip(GEOMETRIES, (
    ("0.35", "--"), ("0.65", "--"), ("#e69f00", "-."), ("#0072b2", "-"), ("#009e73", ":"),
), strict=True))  # fmt: skip
"""Line colour and dash style of each geometry; distinguishable with red-green colour blindness."""
_PROFILES = 5
_SHOWN = (900, 900)  # px, largest size of a photograph
_CONTRACTION = "contraction $(L_0 - L)/L_0$"


def actuation(source: Source) -> Drawn:
    """Plot the isobars: readings, model and band on the left, residuals on the right."""
    figure, (left, right) = _axes(2)
    rest = source.scaled(source.sheet.specimen.rest_length, "length")
    levels = [*source.tables["readings"].sort_values("length").groupby("level")]
    for colour, (level, rows) in zip(_shades(len(levels)), levels, strict=True):
        contraction = 1 - rows.length / rest
        left.fill_between(contraction, rows.low_95, rows.high_95, color=colour, alpha=0.2, lw=0)
        left.plot(contraction, rows.model, color=colour)
        left.annotate(f"{level:.3g}", (contraction.iloc[0], rows.model.iloc[0]), fontsize=6)
        _points(left, contraction, rows.force, colour)
        _points(right, contraction, rows.model_less_measured, colour)
    right.axhline(0, color="0.6", lw=0.6)
    unit = source.unit("force")
    left.set(xlabel=_CONTRACTION, ylabel=f"force $F$ [{unit}]", ylim=(0, None))
    right.set(xlabel=_CONTRACTION, ylabel=f"model \N{MINUS SIGN} measured [{unit}]")
    return figure, (
        f"Left: force against contraction; labels show the gauge pressure [{source.unit('pressure')}]. "
        "Circles are measurements (mean of the shortening and lengthening branches). Lines are the model "
        f"({GEOMETRIES[source.best]}), and bands are expected to contain 95 % of single readings. "
        "Right: residuals, model minus measured."
    )


def photographs(source: Source) -> Drawn:
    """Show three photographs with their outlines, at the smallest, middle and largest contraction."""
    pictures = source.pictures
    if pictures is None:
        return None
    from PIL import Image

    drawn = source.sheet.results / PICTURES / "overlays"
    ordered = sorted(
        (-length, path)
        for name, length in zip(pictures.names, pictures.length, strict=True)
        for path in drawn.glob(f"*_{glob.escape(Path(name).stem)}.jpg")
    )
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    for axes, k in zip(figure.subplots(1, 3), (0, len(ordered) // 2, -1), strict=True):
        length, path = ordered[k]
        image = Image.open(path)
        image.thumbnail(_SHOWN)
        axes.imshow(image, interpolation="none")
        axes.set_title(f"{abs(1 + length / source.sheet.specimen.rest_length):.3f}")
        axes.set_axis_off()
    return figure, (
        "Photographs, with the contraction above each of them. The measured outline is red, the edges of "
        "the end tapes are yellow, and the midline is cyan."
    )


def shape(source: Source) -> Drawn:
    """Plot profiles at five contractions, and the mean and mid-length diameters against contraction."""
    surface, pictures = source.surface, source.pictures
    if surface is None or pictures is None:
        return None
    from scipy.interpolate import CubicSpline

    rest, middle = source.sheet.specimen.rest_length, surface.diameters.shape[-1] // 2
    x = np.linspace(0, 1, surface.diameters.shape[-1])
    every = np.concatenate([surface.diameters[:1], surface.draws[:, 0]])
    at_length = CubicSpline(surface.lengths[::-1], every[:, ::-1], axis=1)
    figure, (left, right) = _axes(2)
    wanted = np.linspace(pictures.length.max(), pictures.length.min(), _PROFILES)
    for colour, at in zip(_shades(_PROFILES), wanted, strict=True):
        k = int(np.argmin(np.abs(pictures.length - at)))
        L = float(pictures.length[k])
        z = source.scaled(x * L, "length")
        _band(left, z, source.scaled(at_length(L), "length"), colour, f"{abs(1 - L / rest):.3f}")
        _points(left, z[::8], source.scaled(pictures.diameter[k, ::8], "length"), colour)
    for label, colour, seen, drawn in (
        ("mean", "#0072b2", pictures.diameter.mean(axis=1), every.mean(axis=2)),
        ("middle", "#d55e00", pictures.diameter[:, middle], every[..., middle]),
    ):  # fmt: skip
        _band(right, 1 - surface.lengths / rest, source.scaled(drawn, "length"), colour, label)
        _points(right, 1 - pictures.length / rest, source.scaled(seen, "length"), colour)
    cylinder = source.middle(CYLINDER)
    right.plot(cylinder.contraction, cylinder.diameter, "--", color="0.35", label="cylinder")
    diameter = f"diameter $D$ [{source.unit('length')}]"
    left.set(xlabel=f"position $z$ [{source.unit('length')}]", ylabel=diameter)
    right.set(xlabel=_CONTRACTION, ylabel=diameter)
    left.legend(title="contraction")
    right.legend()
    return figure, (
        "Measured shape. Circles are measurements from the pictures; lines are the fitted surface with its "
        "95 % band. Left: braid diameter along the axis. Right: mean diameter, diameter at mid-length, "
        "and diameter of the cylinder identified from the force."
    )


def strains(source: Source) -> Drawn:
    """Plot the hoop strain, axial strain and wall thickness of the bladder for each geometry."""
    labels = {
        "mean_hoop_strain": r"mean hoop strain $\varepsilon_c$",
        "axial_strain": r"axial strain $\varepsilon_z$",
        "thickness": f"wall thickness $t$ [{source.unit('length')}]",
    }
    figure, axes = _axes(3)
    rows = pd.concat([source.middle(name) for name in source.fits])
    _lines(axes, rows, "contraction", labels, _CONTRACTION)
    named = "; ".join(f"{name} = {GEOMETRIES[name]}" for name in source.fits)
    return figure, (
        f"Bladder strains and wall thickness at {_middle(source)}. The axial strain is calculated from the "
        f"arc length for measured shapes, and from the active length for cylinders. Geometries: {named}."
    )


def law(source: Source) -> Drawn:
    """Plot the bladder law with the range of strains reached in the test, and the wall stresses."""
    figure, (left, right) = _axes(2)
    plot_law(source.fits[source.best], left, source.sheet.units)
    rows = source.middle(source.best)
    for name, colour in (("axial_stress", "#d55e00"), ("hoop_stress", "#009e73")):
        right.plot(rows.contraction, rows[name], color=colour, label=name.replace("_", " "))
    right.set(xlabel=_CONTRACTION, ylabel=rf"mean stress $\sigma$ [{source.unit('stress')}]")
    right.legend()
    return figure, (
        "Left: bladder law, true stress against engineering strain. "
        f"Right: wall stresses, averaged along the axis, at {_middle(source)} "
        f"({GEOMETRIES[source.best]})."
    )


def parts(source: Source) -> Drawn:
    """Plot the contributions to the force against contraction at one pressure, for each geometry."""
    figure, many = _axes(len(source.fits), share=True)
    data = source.fits[CYLINDER].data
    near = np.abs(data.pressures.level - source.pressures[:, None]).argmin(axis=0)
    near = (near == len(source.pressures) // 2) & data.loaded
    seen = 1 - data.length[near] / source.sheet.specimen.rest_length
    for axes, name in zip(many, source.fits, strict=True):
        rows = source.middle(name)
        for term in PARTS:
            axes.plot(rows.contraction, rows[term], label=term)
        axes.plot(rows.contraction, rows.force, "k--", label="model force")
        _points(axes, seen, source.scaled(data.force[near], "force"), "0.3")
        axes.axhline(0, color="0.6", lw=0.6)
        axes.set(title=name, xlabel="contraction")
    many[0].set(ylabel=f"force $F$ [{source.unit('force')}]")
    figure.legend(*many[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure, (
        f"Contributions to the force at {_middle(source)} for each geometry; circles are measurements."
    )


def by_pressure(source: Source) -> Drawn:
    """Plot blocked force, free contraction, errors and work against pressure for each geometry."""
    force = source.unit("force")
    labels = {
        "blocked_force": f"blocked force [{force}]", "free_contraction": "free contraction",
        "rmse": f"RMSE [{force}]", "left_over_share": r"left over / $\int P\,dV$",
        "efficiency": "efficiency", "work_per_volume_J_m3": "work per volume [J/m$^3$]",
    }  # fmt: skip
    figure = Figure(figsize=(9, 5.2), layout="constrained")
    axes = list(figure.subplots(2, 3).ravel())
    axes[3].axhline(0, color="0.6", lw=0.6)
    x_label = f"gauge pressure $P$ [{source.unit('pressure')}]"
    _lines(axes, source.tables["pressures"], "pressure", labels, x_label)
    return figure, (
        "Top: blocked force, free contraction and force RMSE against pressure for each geometry; circles "
        "are measurements, shown if the test reached that state. Bottom: work from rest to the end of each "
        "stroke. 'Left over' is the fluid's work that goes into neither the load nor the bladder. "
        "If it is negative, the force model creates energy. With the measured shape, this is expected, "
        "because Gaylord's force term was derived for a cylinder. Virtual work conserves energy, but it "
        "needs the derivative of the measured volume, which amplifies errors. In simulations, use the "
        "model from famjax fit. Where a geometry has no line, its force does not reach zero; beyond the "
        "measured contractions, a line is extrapolated. "
        "Efficiency is the work done on the load divided by the work done by the fluid."
    )


FIGURES = (actuation, photographs, shape, strains, law, parts, by_pressure)
"""All figures in their order on the page; the first is shown with the summary."""


def _axes(count: int, *, share: bool = False) -> tuple[Figure, list[Axes]]:
    """Create a row of axes across the page."""
    figure = Figure(figsize=(9, 3.1 if count < 3 else 2.6), layout="constrained")
    return figure, list(figure.subplots(1, count, squeeze=False, sharey=share)[0])


def _lines(
    many: list[Axes], rows: pd.DataFrame, x: str, labels: Mapping[str, str], x_label: str
) -> None:
    """Plot one column per axes against x: lines for the geometries, circles for the test."""
    for axes, (column, label) in zip(many, labels.items(), strict=True):
        for name, of in rows.groupby("geometry", sort=False):
            if (line := LINES.get(str(name))) is not None:
                axes.plot(of[x], of[column], color=line[0], ls=line[1], label=name)
            else:
                _points(axes, of[x], of[column], "black")
        axes.set(xlabel=x_label, ylabel=label)
    many[0].legend()


def _band(axes: Axes, x: np.ndarray, draws: np.ndarray, colour: Any, label: str) -> None:
    """Plot the first of several curves as a line, and the others as a 95 % band."""
    low, high = np.quantile(draws[1:], (0.025, 0.975), axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=0.2, lw=0)
    axes.plot(x, draws[0], color=colour, label=label)


def _points(axes: Axes, x: Any, y: Any, colour: Any) -> None:
    axes.plot(x, y, "o", ms=2.6, mew=0.6, mfc="white", color=colour, zorder=3)


def _middle(source: Source) -> str:
    return source.pressure(source.pressures[len(source.pressures) // 2])


def _shades(count: int) -> Any:
    """Return dark-to-light colours for ordered curves, all dark enough for white paper."""
    return mpl.colormaps["viridis"](np.linspace(0.0, 0.72, count))
