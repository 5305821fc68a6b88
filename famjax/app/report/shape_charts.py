"""Charts of the measured shape: profiles, diameters and volume against contraction."""

from pathlib import Path

import numpy as np

from famjax.boundary.units import factor
from fitting.shapes import Pictures, ShapeSurface

from ..evaluation import CYLINDER
from .chart import AxisQuantity, Chart, PlottedSeries, shades
from .source import COLOURS, DASHES, Source

CONTRACTION = AxisQuantity("contraction", "contraction $(L_0 - L)/L_0$")
_PROFILES, _CIRCLES = 5, 25
_BAND = [0.025, 0.975]
"""Quantiles of the draws."""


def shape_charts(source: Source) -> list[Chart]:
    """Profiles at five contractions, mean and middle diameter, volume; none without photographs."""
    if source.surface is None or source.pictures is None:
        return []
    return [
        draw(source, source.surface, source.pictures) for draw in (_profiles, _diameters, _volume)
    ]


def _profiles(source: Source, surface: ShapeSurface, pictures: Pictures) -> Chart:
    unit = source.unit("length")
    x = np.linspace(0, 1, surface.diameters.shape[-1])
    shown = np.linspace(0, x.size - 1, _CIRCLES).round().astype(int)
    wanted = np.linspace(pictures.length.max(), pictures.length.min(), _PROFILES)
    chosen = [int(np.argmin(np.abs(pictures.length - one))) for one in wanted]
    series = []
    for colour, k in zip(shades(_PROFILES), dict.fromkeys(chosen), strict=False):
        L = float(pictures.length[k])
        name = f"{1 - L / source.sheet.specimen.rest_length:.3f}"
        low, high = np.quantile(_at(surface.lengths, surface.draws[:, 0], L), _BAND, axis=0)
        line = (_at(surface.lengths, surface.diameters[0], L), low, high)
        series += [
            PlottedSeries(name, source.scaled(x * L, "length"),
                   *(source.scaled(one, "length") for one in line), colour=colour),
            PlottedSeries(f"{name}, {Path(pictures.names[k]).name}", source.scaled(x[shown] * L, "length"),
                   source.scaled(pictures.diameter[k, shown], "length"), colour=colour, marker="o",
                   dash="", in_legend=False),
        ]  # fmt: skip
    return Chart(
        "profiles",
        "Braid diameter along the axis at five contractions (numbers in the legend): the measured "
        "surface with its 95 % band, and as circles the picture of that contraction.",
        AxisQuantity("z", "position $z$", unit), AxisQuantity("diameter", "diameter $D$", unit), series,
    )  # fmt: skip


def _at(lengths: np.ndarray, diameters: np.ndarray, length: float) -> np.ndarray:
    """Diameters at a length, shape (..., m), by a spline through those at knots, shape (..., k, m)."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(lengths[::-1], diameters[..., ::-1, :], axis=-2)(length)


def _diameters(source: Source, surface: ShapeSurface, pictures: Pictures) -> Chart:
    rest = source.sheet.specimen.rest_length
    middle = surface.diameters.shape[-1] // 2
    c, taken = 1 - surface.lengths / rest, 1 - pictures.length / rest
    series = []
    for label, colour, seen, line, drawn in (
        ("mean", "#0072b2", pictures.diameter.mean(axis=1), surface.diameters[0].mean(axis=1),
         surface.draws[:, 0].mean(axis=2)),
        ("middle", "#d55e00", pictures.diameter[:, pictures.diameter.shape[1] // 2],
         surface.diameters[0, :, middle], surface.draws[:, 0, :, middle]),
    ):  # fmt: skip
        low, high = np.quantile(drawn, _BAND, axis=0)
        shown = (source.scaled(one, "length") for one in (line, low, high))
        series += [
            PlottedSeries(f"{label}, pictures", taken, source.scaled(seen, "length"), colour=colour,
                   marker="o", dash="", in_legend=False),
            PlottedSeries(label, c, *shown, colour=colour),
        ]  # fmt: skip
    states = source.fits[CYLINDER].states
    series.append(
        PlottedSeries("cylinder of the triangle", states.contraction,
               source.scaled(states.diameter[source.middle], "length"), colour=COLOURS[CYLINDER],
               dash=DASHES[CYLINDER])
    )  # fmt: skip
    return Chart(
        "diameter",
        "Mean and middle diameter of the braid against contraction: circles are pictures, lines the "
        "surface with its 95 % band; dashed the cylinder of the braid's triangle as identified from "
        "the force.",
        CONTRACTION, AxisQuantity("diameter", "diameter $D$", source.unit("length")), series,
    )  # fmt: skip


def _volume(source: Source, surface: ShapeSurface, pictures: Pictures) -> Chart:
    rest = source.sheet.specimen.rest_length
    unit = source.unit("volume")
    scale = factor(unit, "volume")

    def volume(lengths: np.ndarray, diameters: np.ndarray) -> np.ndarray:
        x = np.linspace(0, 1, diameters.shape[-1])
        return lengths * np.trapezoid(np.pi / 4 * diameters**2, x, axis=-1) / scale

    lengths = surface.lengths * surface.draw_scales[:, None]
    low, high = np.quantile(volume(lengths, surface.draws[:, 0]), _BAND, axis=0)
    states = source.fits[CYLINDER].states
    series = [
        PlottedSeries("pictures", 1 - pictures.length / rest, volume(pictures.length, pictures.diameter),
               colour="#0072b2", marker="o", dash="", in_legend=False),
        PlottedSeries("measured shape", 1 - surface.lengths / rest,
               volume(surface.lengths, surface.diameters[0]), low, high, colour="#0072b2"),
        PlottedSeries("cylinder of the triangle", states.contraction,
               states.volume[source.middle] / scale, colour=COLOURS[CYLINDER], dash=DASHES[CYLINDER]),
    ]  # fmt: skip
    return Chart(
        "volume",
        "Volume within the braid's outline against contraction: circles are pictures, the line the "
        "surface with its 95 % band; dashed the cylinder of the braid's triangle.",
        CONTRACTION, AxisQuantity("volume", "volume $V$", unit), series,
    )  # fmt: skip
