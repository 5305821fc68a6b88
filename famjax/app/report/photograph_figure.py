"""Photographs with what was found in them, at low, middle and high contraction of one pressure."""

import base64
import dataclasses
import io
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from famjax.boundary.units import to_si
from fitting.saved import pdf_file
from fitting.shapes import Pictures

from ..evaluation import PICTURES, shown_pictures
from ..sheet import Photographs
from .chart import Drawing
from .source import Source, picture_rows

_HEIGHT = 720  # px, of the tallest photograph as it is shown
_QUALITY = 82  # of the JPEG
_TEXT = 34  # px, of the numbers above


@dataclasses.dataclass(frozen=True)
class _Shown:
    """A picture as it is drawn: its name, contraction, and pixels, RGB."""

    name: str
    contraction: float
    pixels: np.ndarray


def photograph_figure(source: Source) -> list[Drawing]:
    """Three photographs with the outline that was measured; none without photographs."""
    photographs, pictures = source.sheet.photographs, source.pictures
    if photographs is None or pictures is None:
        return []
    shown = _overlays(source, photographs, pictures)
    if not shown:
        return []
    of = source.pressure(source.pressures[source.middle])
    caption = (
        f"Photographs near {of}, the contraction above each, with what was measured: outline red, "
        "edges of the end tapes yellow, mid-line cyan."
    )
    table = "photograph,contraction\n" + "".join(
        f"{one.name},{one.contraction:.6g}\n" for one in shown
    )
    return [Drawing("photographs", caption, _svg(shown), _pdf(shown), table)]


def _overlays(source: Source, photographs: Photographs, pictures: Pictures) -> list[_Shown]:
    """The chosen pictures, measured once more for the lines."""
    from imaging import (
        draw_overlay,
        measure,
        read_image,
        read_recipe,
    )

    recipe = read_recipe(source.results / PICTURES / "recipe.toml")
    files = {path.name: path for path in shown_pictures(source.sheet, photographs)}
    found = []
    for k in _chosen(source, pictures):
        name = Path(pictures.names[k]).name
        image = read_image(files[name])
        lines = max(2, round(2 * max(image.shape) / _HEIGHT))
        drawn = draw_overlay(image, measure(image, recipe).trace, thickness=lines)
        contraction = 1 - pictures.length[k] / source.sheet.specimen.rest_length
        found.append(_Shown(name, float(contraction), drawn))
    return _alike(found)


def _chosen(source: Source, pictures: Pictures) -> list[int]:
    """Pictures of least, middle and most contraction among those at the middle pressure."""
    lengths = pictures.length
    near = np.flatnonzero(_levels(source, pictures) == source.middle)
    near = near if near.size else np.arange(lengths.size)
    ordered = near[np.argsort(-lengths[near])]
    return [int(ordered[k]) for k in sorted({0, ordered.size // 2, ordered.size - 1})]


def _levels(source: Source, pictures: Pictures) -> np.ndarray:
    """Number of the pressure of each picture; -1 where neither pressure nor force tell it.

    Where the machine's log has no pressure, it is that of the isobar nearest in force.
    """
    pressure, length = pictures.pressure, pictures.length
    off = np.abs(pressure[:, None] - source.pressures)
    if not np.isfinite(pressure).all():
        force = _forces(source, pictures)
        model = source.best.states
        known = [
            np.interp(1 - length / model.rest_length, model.contraction, row) for row in model.force
        ]
        off = np.abs(force[:, None] - np.stack(known, axis=1))
    return np.where(np.isfinite(off).all(axis=1), np.argmin(off, axis=1), -1)


def _forces(source: Source, pictures: Pictures) -> np.ndarray:
    """Force [N] when each picture was taken; nan where the log does not tell it."""
    unit = source.unit("force")
    by_name = {row["path"]: row.get(f"force_{unit}", "") for row in picture_rows(source)}
    found = [by_name.get(name, "") for name in pictures.names]
    return np.array([to_si(float(text), unit, "force") if text else np.nan for text in found])


def _alike(found: list[_Shown]) -> list[_Shown]:
    """All at one scale, the tallest at the height that is shown."""
    scale = min(1.0, _HEIGHT / max(one.pixels.shape[0] for one in found))
    small = []
    for one in found:
        height, width = (max(1, round(scale * size)) for size in one.pixels.shape[:2])
        picture = Image.fromarray(one.pixels).resize((width, height), Image.Resampling.LANCZOS)
        small.append(dataclasses.replace(one, pixels=np.asarray(picture)))
    return small


def _svg(shown: list[_Shown]) -> str:
    gap, top = 12, _TEXT + 14
    width = sum(one.pixels.shape[1] for one in shown) + gap * (len(shown) - 1)
    height = max(one.pixels.shape[0] for one in shown) + top
    parts, x = [], 0
    for one in shown:
        tall, wide = one.pixels.shape[:2]
        buffer = io.BytesIO()
        Image.fromarray(one.pixels).save(buffer, "JPEG", quality=_QUALITY)
        data = base64.b64encode(buffer.getvalue()).decode()
        parts.append(
            f'<text x="{x + wide / 2:g}" y="{_TEXT}" font-size="{_TEXT}" text-anchor="middle" '
            f'font-family="DejaVu Sans, sans-serif" fill="#222">{one.contraction:.3f}</text>\n'
            f'<image x="{x}" y="{top}" width="{wide}" height="{tall}" '
            f'href="data:image/jpeg;base64,{data}"/>\n'
        )
        x += wide + gap
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}">\n{"".join(parts)}</svg>\n'
    )


def _pdf(shown: list[_Shown]) -> bytes:
    widths = [one.pixels.shape[1] for one in shown]
    tallest = max(one.pixels.shape[0] for one in shown)
    across = 88 / 25.4
    with mpl.rc_context({"font.size": 7.5, "pdf.fonttype": 42}):
        figure = Figure(
            figsize=(across, across * tallest / sum(widths) + 0.3), layout="constrained"
        )
        for axes, one in zip(
            figure.subplots(1, len(shown), width_ratios=widths, squeeze=False)[0],
            shown,
            strict=True,
        ):
            axes.imshow(one.pixels, interpolation="none")
            axes.set_title(f"{one.contraction:.3f}")
            axes.set_axis_off()
        return pdf_file(figure)
