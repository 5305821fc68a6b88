"""The picture of a fit: isobars with the measured points, residuals, and the stress-strain law."""

import matplotlib as mpl
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import famjax
from famjax.boundary.units import factor, unit_system
from famjax.compile_options import as_arrays, quick_jit

from ..result import Identification, check_identified

_COLOURS = mpl.colormaps["viridis"]
_BEYOND = 1.25  # the law is drawn to this multiple of the strain range
_CURVES = 24  # of the model at most: a map may have as many pressures as readings
_SINGLE = 500  # readings that a page has one by one; more are a picture in it


def plot_fit(result: Identification, system: str = "metric") -> Figure:
    """The figure of an identification: isobars, residuals and material law.

    Args:
        result: what `identify` returned.
        system: "si", "metric" or "us".

    Returns:
        A figure, not shown; save it with `savefig`.
    """
    check_identified(result)
    figure = Figure(figsize=(11, 6.2))
    FigureCanvasAgg(figure)
    # Places are given: a layout engine draws the figure once more before each drawing.
    axes = figure.subplot_mosaic(
        [["isobars", "bar", ".", "residuals"], ["isobars", "bar", ".", "law"]],
        width_ratios=[3, 0.06, 0.62, 2],
        gridspec_kw={
            "left": 0.065, "right": 0.985, "bottom": 0.085, "top": 0.89, "wspace": 0.04,
            "hspace": 0.36,
        },
    )  # fmt: skip
    plot_isobars(result, axes["isobars"], system)
    plot_residuals(result, axes["residuals"], system)
    plot_law(result, axes["law"], system)
    figure.colorbar(
        ScalarMappable(_shade(result, system), _COLOURS),
        cax=axes["bar"],
        label=f"gauge pressure, {unit_system(system)['pressure']}",
    )
    errors = result.errors
    figure.suptitle(
        f"{result.data.specimen.name}: RMSE {errors.rmse:.3g} N ({errors.rmse_percent:.2g} % of "
        f"{errors.max_force:.5g} N), law: {result.law.name}, constraint: {result.constraint}",
        fontsize=11,
    )
    return figure


def _shade(result: Identification, system: str) -> Normalize:
    """The pressures of a map as colours."""
    levels = np.unique(result.data.pressures.level)
    unit = factor(unit_system(system)["pressure"], "pressure")
    return Normalize(levels[0] / unit, levels[-1] / unit)


def _axes(axes: Axes | None) -> Axes:
    """Those given, or those that pyplot draws on."""
    if axes is not None:
        return axes
    from matplotlib import pyplot  # noqa: PLC0415 -- it looks for a screen

    return pyplot.gca()


def plot_isobars(result: Identification, axes: Axes | None = None, system: str = "metric") -> Axes:
    """Force against contraction: the readings and the model, a colour for each pressure.

    Args:
        result: what `identify` returned.
        axes: to draw on; pyplot's current ones unless given.
        system: "si", "metric" or "us".

    Returns:
        The axes.
    """
    check_identified(result)
    axes, shade = _axes(axes), _shade(result, system)
    data, force_unit = result.data, factor(unit_system(system)["force"], "force")
    pressure_unit = factor(unit_system(system)["pressure"], "pressure")
    rest = data.specimen.rest_length
    lengths, loaded = np.linspace(data.length.min(), data.length.max(), 200), data.loaded
    levels = np.unique(data.pressures.level[loaded])
    shown = np.linspace(0, levels.size - 1, min(levels.size, _CURVES)).round().astype(int)
    levels = levels[shown]
    for level, force in zip(levels, result.predict(lengths, levels[:, None]), strict=True):
        axes.plot(
            1 - lengths / rest,
            np.where(force < 0, np.nan, force) / force_unit,
            color=_COLOURS(shade(level / pressure_unit)),
            lw=1,
        )
    axes.scatter(
        1 - data.length[loaded] / rest,
        data.force[loaded] / force_unit,
        c=data.pressure[loaded] / pressure_unit,
        norm=shade,
        cmap=_COLOURS,
        s=20,
        edgecolors="black",
        linewidths=0.4,
        zorder=3,
        rasterized=data.force.size > _SINGLE,
    )
    axes.plot([], [], "o", mfc="white", mec="black", ms=4.5, label="measured")
    axes.plot([], [], color="0.4", lw=1, label="model")
    if data.slack.any():
        axes.plot(
            1 - data.length[data.slack] / rest,
            np.zeros(data.slack.sum()),
            "x",
            color="0.6",
            ms=4,
            clip_on=False,
            label="slack (not data)",
        )
    axes.set(xlabel="contraction", ylabel=f"force, {unit_system(system)['force']}", ylim=(0, None))
    axes.legend(frameon=False)
    return axes


def plot_residuals(
    result: Identification, axes: Axes | None = None, system: str = "metric"
) -> Axes:
    """Model less reading against contraction, a colour for each pressure; arguments of `plot_isobars`."""
    check_identified(result)
    axes, shade = _axes(axes), _shade(result, system)
    data, force_unit = result.data, factor(unit_system(system)["force"], "force")
    loaded, unit = data.loaded, unit_system(system)["force"]
    axes.axhline(0, color="0.7", lw=0.8)
    for sign in (-1, 1):
        axes.axhline(sign * result.errors.rmse / force_unit, color="0.7", lw=0.8, ls=":")
    axes.scatter(
        1 - data.length[loaded] / data.specimen.rest_length,
        result.residuals / force_unit,
        c=data.pressure[loaded] / factor(unit_system(system)["pressure"], "pressure"),
        norm=shade,
        cmap=_COLOURS,
        s=14,
        rasterized=data.force.size > _SINGLE,
    )
    axes.set(xlabel="contraction", ylabel=f"model - measured, {unit}")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_title("residuals; dotted: +- RMSE", fontsize=9)
    return axes


def plot_law(result: Identification, axes: Axes | None = None, system: str = "metric") -> Axes:
    """Stress of the bladder against its strain, dashed where it falls; arguments of `plot_isobars`."""
    check_identified(result)
    axes = _axes(axes)
    unit = unit_system(system)["stress"]
    strain = np.linspace(0, _BEYOND * result.strain_range, 400)
    for label, true_stress in _laws(result, strain):
        stress = true_stress / factor(unit, "stress")
        unstable = np.gradient(stress, strain) < 0
        (line,) = axes.plot(strain, np.where(unstable, np.nan, stress), label=label)
        axes.plot(strain, np.where(unstable, stress, np.nan), color=line.get_color(), ls="--")
    axes.axvspan(0, result.strain_range, color="0.92", zorder=0, label="strain range used")
    axes.set(xlabel="engineering strain", ylabel=f"true stress, {unit}", xlim=(0, strain[-1]))
    axes.set_title("bladder law; dashed where falling", fontsize=9)
    axes.legend(frameon=False, fontsize=8)
    return axes


def _laws(result: Identification, strain: np.ndarray) -> list[tuple[str | None, np.ndarray]]:
    """Labels and stresses [Pa] of the curves that show the law: of one direction by itself."""
    material, nodes = result.muscle.material, result.node_pressures
    pressures = (
        np.zeros(1) if nodes is None else nodes[sorted({0, len(nodes) // 2, len(nodes) - 1})]
    )
    stresses = np.asarray(quick_jit(law_stress)(as_arrays(material), strain, pressures[:, None]))
    if nodes is not None:
        labels = [f"at {pressure / 1e3:.4g} kPa" for pressure in pressures]
    else:
        labels = ["tensile test" if hasattr(material, "uniaxial_stress") else None]
    return list(zip(labels, stresses, strict=True))


def law_stress(
    material: famjax.materials.AbstractMaterial, strain: famjax.Real, pressure: famjax.Real
) -> Float[Array, "pressures strains"]:
    """Stress [Pa] of a tensile test, or where the directions do not interact of either of them."""
    tensile = getattr(material, "uniaxial_stress", None)
    if tensile is not None:
        return tensile(strain)[None]
    return material.stresses(strain, strain, pressure)[0] + 0 * pressure
