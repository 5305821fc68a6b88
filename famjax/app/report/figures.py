"""Figures of the report: each function draws one with its caption, or returns None."""

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fitting.prediction import model_forces, static_rows
from fitting.report import law_stress

from ..evaluation import CYLINDER, PICTURES, shown_pictures
from .source import COLOURS, DASHES, KINDS, MINUS, FittedGeometry, Source

Drawn = tuple[Figure, str] | None
"""A figure and its caption; None if the folder lacks the data."""

STYLE: dict[Any, Any] = {
    "font.size": 8, "axes.labelsize": 8, "axes.titlesize": 8, "xtick.labelsize": 7,
    "ytick.labelsize": 7, "legend.fontsize": 7, "axes.linewidth": 0.6, "lines.linewidth": 1.1,
    "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False,
    "svg.fonttype": "path", "axes.formatter.limits": (-3, 4), "axes.formatter.use_mathtext": True,
}  # fmt: skip
_BAND = (0.025, 0.975)
_POINTS = 25
"""Number of contractions at which the error band is computed."""
_PROFILES = 5
_HEIGHT = 480  # px, of the tallest photograph as shown
_BEYOND = 1.25
"""The law is drawn to this multiple of the strains reached."""
_CONTRACTION = "contraction $(L_0 - L)/L_0$"


def actuation(source: Source) -> Drawn:
    """Plot isobars with readings, model, band and residuals."""
    fit, data, rest = source.best, source.data, source.sheet.specimen.rest_length
    levels = np.unique(data.pressures.level[data.loaded])
    lengths = np.linspace(float(fit.data.length.max()), float(fit.data.length.min()), _POINTS)
    P, L = (one.ravel() for one in np.meshgrid(levels, lengths, indexing="ij"))
    rows = static_rows(fit.saved, L, P)
    force, low, high = (
        source.scaled(np.array([row[key] for row in rows], float), "force").reshape(levels.size, -1)
        for key in ("force_N", "low_95_N", "high_95_N")
    )
    figure, (left, right) = _axes(2)
    for k, (colour, level) in enumerate(zip(_shades(levels.size), levels, strict=True)):
        of = (data.pressures.level == level) & data.loaded
        left.fill_between(1 - lengths / rest, low[k], high[k], color=colour, alpha=0.2, lw=0)
        left.plot(1 - lengths / rest, force[k], color=colour)
        _points(left, 1 - data.length[of] / rest, source.scaled(data.force[of], "force"), colour)
        at = (1 - lengths[-1] / rest, force[k][-1])
        left.annotate(source.number(level, "pressure", 3), at, (2.5, 0), fontsize=6, color=colour,
                      textcoords="offset points", va="center")  # fmt: skip
        mine = fit.levels == level
        left_over = source.scaled(fit.residuals[mine], "force")
        _points(right, 1 - fit.data.length[fit.data.loaded][mine] / rest, left_over, colour)
    middle = levels.size // 2
    half = source.scaled(
        model_forces(fit.saved, lengths, np.full(_POINTS, levels[middle])).half, "force"
    )
    right.fill_between(1 - lengths / rest, -half, half, color="0.5", alpha=0.2, lw=0)
    right.axhline(0, color="0.6", lw=0.6)
    unit = source.unit("force")
    left.set(xlabel=_CONTRACTION, ylabel=f"force $F$ [{unit}]", ylim=(0, None))
    right.set(xlabel=_CONTRACTION, ylabel=f"model {MINUS} measured [{unit}]")
    return figure, (
        f"Left: force against contraction; labels give the gauge pressure [{source.unit('pressure')}]. "
        f"Circles are measurements (mean of both branches), lines the model with the {fit.title}; shaded "
        "bands contain 95 % of single readings. Right: residuals, model minus measured, with the band at "
        f"{source.pressure(levels[middle])}."
    )


def photographs(source: Source) -> Drawn:
    """Show three photographs with measured outlines, at smallest, middle and largest contraction."""
    given, pictures = source.sheet.photographs, source.pictures
    if given is None or pictures is None:
        return None
    from PIL import Image

    from imaging import draw_overlay, measure, read_image, read_recipe

    recipe = read_recipe(source.sheet.results / PICTURES / "recipe.toml")
    files = {path.name: path for path in shown_pictures(source.sheet, given)}
    off = np.abs(pictures.pressure[:, None] - source.pressures)
    near = np.flatnonzero(np.isfinite(off).all(axis=1) & (off.argmin(axis=1) == source.middle))
    near = near if near.size else np.arange(pictures.length.size)
    ordered = near[np.argsort(-pictures.length[near])]
    shown = []
    for k in ordered[sorted({0, ordered.size // 2, ordered.size - 1})]:
        image = read_image(files[Path(pictures.names[k]).name])
        outline = measure(image, recipe).trace
        drawn = draw_overlay(
            image, outline, thickness=max(2, round(2 * max(image.shape) / _HEIGHT))
        )
        small = Image.fromarray(drawn)
        small.thumbnail((2 * _HEIGHT, _HEIGHT))
        contraction = 1 - pictures.length[k] / source.sheet.specimen.rest_length
        shown.append((float(contraction), np.asarray(small)))
    widths = [one.shape[1] for _, one in shown]
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    axes = figure.subplots(1, len(shown), width_ratios=widths, squeeze=False)[0]
    for one, (contraction, pixels) in zip(axes, shown, strict=True):
        one.imshow(pixels, interpolation="none")
        one.set_title(f"{abs(contraction):.3f}")
        one.set_axis_off()
    return figure, (
        f"Photographs near {source.pressure(source.pressures[source.middle])}; titles give the "
        "contraction. The measured outline is red, the edges of the end tapes are yellow, the midline "
        "is cyan."
    )


def shape(source: Source) -> Drawn:
    """Plot profiles at five contractions, and mean and middle diameter against contraction."""
    surface, pictures = source.surface, source.pictures
    if surface is None or pictures is None:
        return None
    from scipy.interpolate import CubicSpline

    rest, middle = source.sheet.specimen.rest_length, surface.diameters.shape[-1] // 2
    x = np.linspace(0, 1, surface.diameters.shape[-1])
    figure, (left, right) = _axes(2)
    wanted = np.linspace(pictures.length.max(), pictures.length.min(), _PROFILES)
    for colour, at in zip(_shades(_PROFILES), wanted, strict=True):
        k = int(np.argmin(np.abs(pictures.length - at)))
        L = float(pictures.length[k])
        z = source.scaled(x * L, "length")
        every = CubicSpline(surface.lengths[::-1], surface.draws[:, 0, ::-1], axis=-2)(L)
        low, high = np.quantile(source.scaled(every, "length"), _BAND, axis=0)
        line = CubicSpline(surface.lengths[::-1], surface.diameters[0, ::-1], axis=-2)(L)
        left.fill_between(z, low, high, color=colour, alpha=0.2, lw=0)
        left.plot(z, source.scaled(line, "length"), color=colour, label=f"{abs(1 - L / rest):.3f}")
        _points(left, z[::8], source.scaled(pictures.diameter[k, ::8], "length"), colour)
    for label, colour, seen, line, drawn in (
        ("mean", "#0072b2", pictures.diameter.mean(axis=1), surface.diameters[0].mean(axis=1),
         surface.draws[:, 0].mean(axis=2)),
        ("middle", "#d55e00", pictures.diameter[:, pictures.diameter.shape[1] // 2],
         surface.diameters[0, :, middle], surface.draws[:, 0, :, middle]),
    ):  # fmt: skip
        low, high = np.quantile(source.scaled(drawn, "length"), _BAND, axis=0)
        c = 1 - surface.lengths / rest
        _points(right, 1 - pictures.length / rest, source.scaled(seen, "length"), colour)
        right.fill_between(c, low, high, color=colour, alpha=0.2, lw=0)
        right.plot(c, source.scaled(line, "length"), color=colour, label=label)
    states = source.fits[CYLINDER].states.isel(pressure=source.middle)
    cylinder = source.scaled(states.diameter, "length")
    right.plot(states.contraction, cylinder, "--", color=COLOURS[CYLINDER], label="cylinder")
    unit = source.unit("length")
    left.set(xlabel=f"position $z$ [{unit}]", ylabel=f"diameter $D$ [{unit}]")
    right.set(xlabel=_CONTRACTION, ylabel=f"diameter $D$ [{unit}]")
    left.legend(title="contraction")
    right.legend()
    return figure, (
        "Measured shape. Circles are pictures; lines are the fitted surface with its 95 % band. Left: "
        "braid diameter along the axis. Right: mean and middle diameter, and the cylinder identified from "
        "the force."
    )


def strains(source: Source) -> Drawn:
    """Plot hoop strain, axial strain and wall thickness of the bladder by geometry."""
    figure, several = _axes(3)
    labels = {
        "mean_hoop_strain": r"mean hoop strain $\varepsilon_c$",
        "axial_strain": r"axial strain $\varepsilon_z$",
        "thickness": f"wall $t$ [{source.unit('length')}]",
    }
    for axes, (name, label) in zip(several, labels.items(), strict=True):
        for fit in source.fits.values():
            of = fit.states.isel(pressure=source.middle)
            values = source.scaled(of[name].values, KINDS[name])
            style: dict[str, Any] = {"color": COLOURS[fit.name], "ls": DASHES[fit.name]}
            axes.plot(of.contraction, values, label=fit.short, **style)
        axes.set(xlabel=_CONTRACTION, ylabel=label)
    several[0].legend()
    named = "; ".join(f"{fit.short} = {fit.title}" for fit in source.fits.values())
    return figure, (
        "Bladder strains and wall thickness at "
        f"{source.pressure(source.pressures[source.middle])}. The axial strain uses the arc length of "
        f"measured shapes and the length of cylinders. Geometries: {named}."
    )


def law(source: Source) -> Drawn:
    """Plot the law of each geometry with the strains reached, and the stresses in the wall."""
    figure, (left, right) = _axes(2)
    best, k = source.best, source.middle
    low, high = _visited(best)
    left.axvspan(low, 0.0, color="#f3e4d8", lw=0, label="axial strains")
    left.axvspan(0.0, high, color="#dfeaf2", lw=0, label="hoop strains")
    left.axhline(0, color="0.6", lw=0.6)
    for name, fit in source.fits.items():
        least, most = _visited(fit)
        strain = np.linspace(_BEYOND * least, _BEYOND * most, 301)
        stress = law_stress(fit.saved.muscle.material, jnp.asarray(strain), jnp.zeros((1, 1)))
        shown = source.scaled(np.asarray(stress)[0], "stress")
        falls = np.gradient(shown, strain) < 0
        width = 1.8 if fit is best else 0.8
        left.plot([], [], color=COLOURS[name], lw=width, label=fit.short)
        for line, hidden in (("-", falls), (":", ~falls)):
            left.plot(strain, np.where(hidden, np.nan, shown), line, color=COLOURS[name], lw=width)
    for name, colour in (("axial", "#d55e00"), ("hoop", "#009e73")):
        stress = source.scaled(best.states[f"{name}_stress"].values[k], "stress")
        right.plot(best.states.contraction, stress, color=colour, label=name)
    unit = source.unit("stress")
    left.set(xlabel=r"strain $\varepsilon$", ylabel=rf"stress $\sigma$ [{unit}]")
    right.set(xlabel=_CONTRACTION, ylabel=rf"mean stress $\sigma$ [{unit}]")
    left.legend(frameon=True, framealpha=1)
    right.legend()
    return figure, (
        "Left: bladder law, true stress against engineering strain; dotted where stress falls with strain, "
        f"which is unstable by itself. Shading marks the strains reached ({best.title}). Right: axial "
        f"means of the wall stresses at {source.pressure(source.pressures[k])} ({best.title})."
    )


def parts(source: Source) -> Drawn:
    """Plot the parts of the force against contraction at one pressure, by geometry."""
    k, unit = source.middle, source.unit("force")
    pressure = source.pressures[k]
    near = np.isclose(source.data.pressures.level, pressure, rtol=0.02) & source.data.loaded
    seen = 1 - source.data.length[near] / source.sheet.specimen.rest_length
    figure, many = _axes(len(source.fits), share=True)
    for axes, fit in zip(many, source.fits.values(), strict=True):
        of = fit.states.isel(pressure=k)
        for number, term in enumerate(of.term.values):
            colour = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")[min(number, 3)]
            values = source.scaled(of.terms.sel(term=term), "force")
            axes.plot(of.contraction, values, color=colour, label=term)
        axes.plot(of.contraction, source.scaled(of.force, "force"), "k--", label="model force")
        _points(axes, seen, source.scaled(source.data.force[near], "force"), "0.3")
        axes.axhline(0, color="0.6", lw=0.6)
        axes.set(title=fit.short, xlabel="contraction")
    many[0].set(ylabel=f"force $F$ [{unit}]")
    figure.legend(*many[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure, (
        f"Parts of the force at {source.pressure(pressure)} by geometry; circles are measurements."
    )


def by_pressure(source: Source) -> Drawn:
    """Plot blocked force, free contraction and RMSE by pressure and geometry."""
    figure, several = _axes(3)
    pressure, force = source.unit("pressure"), source.unit("force")
    P = source.scaled(source.pressures, "pressure")
    for name, fit in source.fits.items():
        style: dict[str, Any] = {"color": COLOURS[name], "ls": DASHES[name], "label": fit.short}
        several[0].plot(P, source.scaled(fit.states.blocked_force, "force"), **style)
        several[1].plot(P, fit.states.free_contraction, **style)
        found = by_level(fit)
        levels = source.scaled(np.array([*found]), "pressure")
        inside, _, left_out = source.scaled(np.array([*found.values()]).T, "force")
        several[2].plot(levels, inside, "o-", ms=2.5, color=COLOURS[name], label=fit.short)
        several[2].plot(levels, left_out, "s:", ms=2.5, color=COLOURS[name])
    if source.isobars:
        for axes, key, kind in zip(several, ("blocked_force_N", "free_contraction"),
                                   ("force", "number"), strict=False):  # fmt: skip
            seen = np.array([bar[key] for bar in source.isobars], float)
            _points(axes, P, source.scaled(seen, kind), "black")
    labels = (f"blocked force [{force}]", "free contraction", f"RMSE [{force}]")
    for axes, label in zip(several, labels, strict=True):
        axes.set(xlabel=f"gauge pressure $P$ [{pressure}]", ylabel=label)
    several[2].set_ylim(0, None)
    several[0].legend()
    return figure, (
        "Blocked force, free contraction and RMSE of the force by pressure and geometry. Circles are "
        "measurements, where the test reached them; dotted lines are errors at held-out pressures."
    )


def work(source: Source) -> Drawn:
    """Plot the work budget of each stroke by pressure and geometry."""
    figure, (left, efficiency, density) = _axes(3)
    P = source.scaled(source.pressures, "pressure")
    for name, fit in source.fits.items():
        style: dict[str, Any] = {"color": COLOURS[name], "ls": DASHES[name], "label": fit.short}
        left.plot(P, 100 * np.asarray(fit.work.left_over / fit.work.fluid), **style)
        efficiency.plot(P, 100 * np.asarray(fit.work.efficiency), **style)
        density.plot(P, np.asarray(fit.work.density) / 1e3, **style)
    left.axhline(0, color="0.6", lw=0.6)
    pressure = source.unit("pressure")
    for axes, label in (
        (left, r"left over [% of $\int P\,dV$]"), (efficiency, "efficiency [%]"),
        (density, "work per volume [kJ/m$^3$]"),
    ):  # fmt: skip
        axes.set(xlabel=f"gauge pressure $P$ [{pressure}]", ylabel=label)
    left.legend()
    return figure, (
        "Work from rest to the end of each stroke. Left over is the fluid's work that neither the load "
        "nor the bladder receives; a negative value means that the force model creates work. Efficiency "
        "is the work on the load divided by the work of the fluid."
    )


FIGURES = (actuation, photographs, shape, strains, law, parts, by_pressure, work)
"""All figures in page order; the first is part of the summary."""


def by_level(fit: FittedGeometry) -> dict[float, tuple[float, float, float]]:
    """Return, by pressure level [Pa], RMSE and largest error in sample and held-out RMSE [N], or nan."""
    out = fit.saved.document.get("leave_one_pressure_out") or {"left_out": [], "group_rmse_N": []}
    found = {}
    for level in np.unique(fit.levels).tolist():
        left = fit.residuals[fit.levels == level]
        missed = [
            rmse
            for one, rmse in zip(out["left_out"], out["group_rmse_N"], strict=True)
            if np.isclose(one, level) and rmse is not None
        ]
        largest = float(np.abs(left).max())
        found[level] = (float(np.sqrt(np.mean(left**2))), largest, *(missed[:1] or [np.nan]))
    return found


def _visited(fit: FittedGeometry) -> tuple[float, float]:
    """Return the lowest and highest bladder strain over the stroke, axial and hoop."""
    low, high = fit.states.axial_strain.min(), fit.states.most_hoop_strain.max()
    return min(0.0, float(low)), float(high)


def _axes(count: int, *, share: bool = False) -> tuple[Figure, list[Axes]]:
    """Create a row of axes across the page."""
    figure = Figure(figsize=(9, 3.1 if count < 3 else 2.6), layout="constrained")
    return figure, list(figure.subplots(1, count, squeeze=False, sharey=share)[0])


def _points(axes: Axes, x: NDArray[Any], y: NDArray[Any], colour: Any) -> None:
    axes.plot(x, y, "o", ms=2.6, mew=0.6, mfc="white", color=colour, zorder=3)


def _shades(count: int) -> list[tuple[float, ...]]:
    """Return dark-to-light colours for ordered curves, all dark enough for white paper."""
    return [tuple(mpl.colormaps["viridis"](at)[:3]) for at in np.linspace(0.0, 0.72, count)]
