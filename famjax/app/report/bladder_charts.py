"""Charts of the bladder: orders of strain, wall, stress law with the range where it is stable."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

import famjax
from fitting.saved import law_stress

from .chart import AxisQuantity, Chart, PlottedSeries, Span
from .shape_charts import CONTRACTION
from .source import COLOURS, DASHES, MINUS, FittedGeometry, Source
from .states import POWERS

_BEYOND = 1.25
"""The law is drawn to this multiple of the strains that were visited."""


def strain_charts(source: Source) -> list[Chart]:
    """Axial means of the powers of the hoop strain, axial strain and wall thickness, by geometry."""
    k = source.middle
    at = f"at {source.pressure(source.pressures[k])}, by geometry"
    charts = []
    for n in POWERS:
        power = "" if n == 1 else f"^{n}"
        charts.append(
            _by_geometry(
                source, f"hoop-strain-{n}", f"Axial mean of the hoop strain's power {n} {at}.",
                AxisQuantity(f"mean_hoop_strain_{n}", rf"mean of $\varepsilon_c{power}$"),
                lambda fit, n=n: fit.states.hoop_powers[n - 1, k],
            )
        )  # fmt: skip
    charts.append(
        _by_geometry(
            source, "axial-strain",
            f"Axial strain {at}: of the arc length where the shape is measured, of the length in "
            "cylinders.",
            AxisQuantity("axial_strain", r"axial strain $\varepsilon_z$"),
            lambda fit: fit.states.axial_strain[k],
        )
    )  # fmt: skip
    charts.append(
        _by_geometry(
            source, "wall", f"Thickness of the bladder's wall {at}.",
            AxisQuantity("thickness", "wall $t$", source.unit("length")),
            lambda fit: source.scaled(fit.states.thickness[k], "length"),
        )
    )  # fmt: skip
    return charts


def _by_geometry(
    source: Source,
    name: str,
    caption: str,
    y: AxisQuantity,
    values: Callable[[FittedGeometry], np.ndarray],
) -> Chart:
    series = [
        PlottedSeries(fit.short, fit.states.contraction, values(fit), colour=COLOURS[geometry],
               dash=DASHES[geometry], in_legend=name == "hoop-strain-1")
        for geometry, fit in source.fits.items()
    ]  # fmt: skip
    return Chart(name, caption, CONTRACTION, y, series, size="small")


def visited(fit: FittedGeometry) -> tuple[float, float]:
    """Lowest and highest strain of the bladder over the stroke, axial and hoop."""
    states = fit.states
    low = min(0.0, float(np.nanmin(states.axial_strain)))
    return low, float(np.nanmax(states.most_hoop_strain))


def stable_range(fit: FittedGeometry) -> tuple[float, float] | None:
    """As `rising_range`, of a fit's law a quarter beyond the strains that were visited."""
    return rising_range(fit.saved.muscle.material, *(_BEYOND * end for end in visited(fit)))


def rising_range(
    material: famjax.materials.AbstractMaterial, low: float, high: float
) -> tuple[float, float] | None:
    """Strains about zero between which the stress of one direction rises.

    Args:
        material: stress law.
        low: strain from which it is looked at, <= 0.
        high: strain up to which it is, > 0.

    Returns:
        Ends to a three-hundredth of the range, those given where it rises up to them; None where it
        falls at zero.
    """
    strain, stress = _law(material, low, high)
    falls = np.diff(stress) < 0
    centre = (strain[1:] + strain[:-1]) / 2
    if falls[int(np.argmin(np.abs(centre)))]:
        return None
    below, above = centre[falls & (centre < 0)], centre[falls & (centre > 0)]
    return float(below.max(initial=low)), float(above.min(initial=high))


def law_charts(source: Source) -> list[Chart]:
    """The law of each geometry, with the strains visited; the stresses in the wall over the stroke."""
    best, unit = source.best, source.unit("stress")
    low, high = visited(best)
    series = []
    for geometry, fit in source.fits.items():
        strain, stress = _law(fit.saved.muscle.material, *(_BEYOND * end for end in visited(fit)))
        least, most = stable_range(fit) or (0.0, 0.0)
        inside = (strain >= least) & (strain <= most)
        shown = source.scaled(stress, "stress")
        thick = 1.8 if fit is best else 0.8
        colour = COLOURS[geometry]
        series.append(
            PlottedSeries(
                fit.short, strain, np.where(inside, shown, np.nan), colour=colour, width=thick
            )
        )
        if not inside.all():
            outside = np.where(inside, np.nan, shown)
            series.append(
                PlottedSeries(f"{fit.short}, not stable", strain, outside, colour=colour, dash=":",
                       in_legend=False, width=thick)
            )  # fmt: skip
    ends = stable_range(best)
    if ends is None:
        stable = "It falls at zero strain: by itself it is not stable there (dotted)."
    else:
        rises = f"{ends[0]:.3g} to {ends[1]:.3g}".replace("-", MINUS)
        whole = np.allclose(ends, (_BEYOND * low, _BEYOND * high))
        stable = (
            f"It rises, and is stable, on all that is drawn, {rises}."
            if whole
            else f"It rises, and is stable by itself, from {rises}; dotted beyond."
        )
    law = Chart(
        "law",
        f"The bladder's law: true stress against engineering strain. Shaded are the strains visited "
        f"over the stroke with the {best.title}: axial (left of zero) and hoop. {stable}",
        AxisQuantity("strain", r"strain $\varepsilon$"), AxisQuantity("stress", r"stress $\sigma$", unit),
        series,
        spans=[Span("axial strains", low, 0.0, "#f3e4d8"), Span("hoop strains", 0.0, high, "#dfeaf2")],
        zero=True,
    )  # fmt: skip
    return [law, _wall_stresses(source)]


def _wall_stresses(source: Source) -> Chart:
    k, fit = source.middle, source.best
    c = fit.states.contraction
    series = [
        PlottedSeries(label, c, source.scaled(values[k], "stress"), colour=colour)
        for label, values, colour in (
            ("axial", fit.states.axial_stress, "#d55e00"), ("hoop", fit.states.hoop_stress, "#009e73"),
        )
    ]  # fmt: skip
    return Chart(
        "wall-stress",
        f"Axial means of the stresses in the wall over the stroke at "
        f"{source.pressure(source.pressures[k])}, {fit.title}.",
        CONTRACTION, AxisQuantity("stress", r"mean stress $\sigma$", source.unit("stress")), series,
        zero=True,
    )  # fmt: skip


def _law(
    material: famjax.materials.AbstractMaterial, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Strains and the law's stresses [Pa]."""
    strain = np.linspace(low, high, 301)
    return strain, np.asarray(law_stress(material, jnp.asarray(strain), jnp.zeros((1, 1))))[0]
