"""Charts of the measured shape: profiles, diameters and volume against contraction."""

import numpy as np

from famjax.boundary.units import factor

from ..evaluation import CYLINDER
from .chart import Chart, Quantity, Series, shades
from .source import COLOURS, DASHES, Source

CONTRACTION = Quantity("contraction", "contraction $(L_0 - L)/L_0$")
_PROFILES = 5
_BAND = [0.025, 0.975]
"""Quantiles of the draws."""


def shape_charts(source: Source) -> list[Chart]:
    """Profiles at five contractions, mean and middle diameter, volume; none without photographs."""
    if source.surface is None or source.pictures is None:
        return []
    return [_profiles(source), _diameters(source), _volume(source)]


def _profiles(source: Source) -> Chart:
    surface, pictures = source.surface, source.pictures
    assert surface is not None
    assert pictures is not None
    unit = source.unit("length")
    x = np.linspace(0, 1, surface.diameters.shape[-1])
    chosen = np.linspace(0, len(surface.lengths) - 1, _PROFILES).round().astype(int)
    series = []
    for colour, k in zip(shades(_PROFILES), chosen, strict=True):
        L = float(surface.lengths[k])
        contraction = 1 - L / source.sheet.specimen.rest_length
        low, high = np.quantile(surface.draws[:, 0, k], _BAND, axis=0)
        series.append(
            Series(
                f"{contraction:.3f}", source.scaled(x * L, "length"),
                source.scaled(surface.diameters[0, k], "length"),
                source.scaled(low, "length"), source.scaled(high, "length"), colour=colour,
            )
        )  # fmt: skip
        near = int(np.argmin(np.abs(pictures.length - L)))
        at = np.linspace(0, pictures.diameter.shape[1] - 1, 25).round().astype(int)
        series.append(
            Series(
                f"picture nearest to {contraction:.3f}, {pictures.names[near]}",
                source.scaled(at / (pictures.diameter.shape[1] - 1) * pictures.length[near], "length"),
                source.scaled(pictures.diameter[near, at], "length"),
                colour=colour, marker="o", dash="", told=False,
            )
        )  # fmt: skip
    return Chart(
        "profiles",
        "Braid diameter along the axis at five contractions (numbers in the legend): the measured "
        "surface with its 95 % band, and as circles the picture nearest in length to each.",
        Quantity("z", "position $z$", unit), Quantity("diameter", "diameter $D$", unit), series,
    )  # fmt: skip


def _diameters(source: Source) -> Chart:
    surface, pictures = source.surface, source.pictures
    assert surface is not None
    assert pictures is not None
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
            Series(f"{label}, pictures", taken, source.scaled(seen, "length"), colour=colour,
                   marker="o", dash="", told=False),
            Series(label, c, *shown, colour=colour),
        ]  # fmt: skip
    states = source.fits[CYLINDER].states
    series.append(
        Series("cylinder of the triangle", states.contraction,
               source.scaled(states.diameter[source.middle], "length"), colour=COLOURS[CYLINDER],
               dash=DASHES[CYLINDER])
    )  # fmt: skip
    return Chart(
        "diameter",
        "Mean and middle diameter of the braid against contraction: circles are pictures, lines the "
        "surface with its 95 % band; dashed the cylinder of the braid's triangle as identified from "
        "the force.",
        CONTRACTION, Quantity("diameter", "diameter $D$", source.unit("length")), series,
    )  # fmt: skip


def _volume(source: Source) -> Chart:
    surface, pictures = source.surface, source.pictures
    assert surface is not None
    assert pictures is not None
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
        Series("pictures", 1 - pictures.length / rest, volume(pictures.length, pictures.diameter),
               colour="#0072b2", marker="o", dash="", told=False),
        Series("measured shape", 1 - surface.lengths / rest,
               volume(surface.lengths, surface.diameters[0]), low, high, colour="#0072b2"),
        Series("cylinder of the triangle", states.contraction,
               states.volume[source.middle] / scale, colour=COLOURS[CYLINDER], dash=DASHES[CYLINDER]),
    ]  # fmt: skip
    return Chart(
        "volume",
        "Volume within the braid's outline against contraction: circles are pictures, the line the "
        "surface with its 95 % band; dashed the cylinder of the braid's triangle.",
        CONTRACTION, Quantity("volume", "volume $V$", unit), series,
    )  # fmt: skip
