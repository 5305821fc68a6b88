"""From files by their names to a folder of results: recipe, campaign, and pictures for a check by eye."""

import dataclasses
import glob
import hashlib
import io
import math
import os
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from famjax.boundary.tasks import AnyExecutor
from famjax.boundary.units import factor, finite_or_none, parse_quantity, unit_system

from .camera import Image, Scale
from .campaign import Table, column_name, process
from .errors import ImagingError
from .measurement import draw_overlay, measure
from .photograph import read_image, readable_part
from .recipe import QualityLimits, Recipe, read_recipe, write_recipe
from .ruler import calibrate_ruler

_JPEG = 95  # of the overlays' JPEG files
_FACE, _GAP, _LINE = 240, 8, 15  # px: longer side of a picture, space between, line of text
_LETTERS, _LINES = 46, 4  # of a line; of what was measured or what was wrong
_GOOD, _BAD, _INK = (60, 160, 60), (210, 40, 40), (20, 20, 20)
_PAPER, _UNREADABLE = (245, 245, 245), (200, 200, 200)
_PROFILES = 40  # drawn at most, evenly over the contraction
_MARGINS = {"left": 0.07, "right": 0.98, "top": 0.95, "bottom": 0.07, "wspace": 0.25, "hspace": 0.3}
"""Of the four axes: a layout by matplotlib's solver costs as much time as all else of the figure."""
_COLOURS = mpl.colormaps["viridis"]
_QUALITY = (
    "blur_px", "tape_sd_px", "residual_rms", "outlier_fraction", "misfit", "kappa", "axis_kink",
    "saturated",
)  # fmt: skip
"""Quality figures drawn: those that have a largest value."""


def write_check_pictures(
    table: Table, recipe: Recipe, folder: Path, number: int = 12, system: str = "us"
) -> list[Path]:
    """Write `profiles.png`, `contact_sheet.png` and some `overlays/`.

    Args:
        table: of the campaign.
        recipe: by which it was measured.
        folder: made if need be.
        number: of pictures on the sheet and of overlays: some of those that failed, the others
            evenly over the contraction. They are measured once more.
        system: units of the plots.

    Returns:
        What was written, the folder of overlays as one.
    """
    overlays = folder / "overlays"
    overlays.mkdir(parents=True, exist_ok=True)
    tiles = []
    for k in choose(table, number):
        path = Path(table.path[k])
        seen = readable_part(path)
        if table.ok[k] and seen is not None:
            trace = measure(seen, recipe).trace
            _save(overlays / f"{k + 1:06d}_{path.stem}.jpg", draw_overlay(seen, trace))
            seen = draw_overlay(seen, trace, thickness=_thick(seen))
        tiles.append(Tile(seen, path.name, _text(table, int(k), system), ok=bool(table.ok[k])))
    plot = io.BytesIO()
    plot_table(table, system, recipe.limits).savefig(plot, format="png", dpi=130)
    profiles = folder / "profiles.png"
    profiles.write_bytes(plot.getvalue())
    sheet = [_save(folder / "contact_sheet.png", contact_sheet(tiles))] if tiles else []
    return [*sheet, profiles, overlays]


def choose(table: Table, number: int) -> NDArray[np.intp]:
    """The pictures to inspect: up to a third of them failed ones, the others spread over the stroke."""
    failed = np.flatnonzero(~table.ok)
    good = np.flatnonzero(table.ok)
    n_failed = min(len(failed), max(number // 3, number - len(good)))
    ordered = good[np.argsort(table["contraction"][good])] if len(good) else good
    chosen = [_evenly(failed, n_failed), _evenly(ordered, number - n_failed)]
    return np.sort(np.concatenate(chosen))


def _evenly(which: NDArray[np.intp], number: int) -> NDArray[np.intp]:
    if not len(which) or number < 1:
        return which[:0]
    at = np.linspace(0, len(which) - 1, min(number, len(which)))
    return which[np.round(at).astype(int)]


def _thick(image: Image) -> int:
    """Lines that can still be seen when the picture has been made small."""
    return max(1, round(max(image.shape) / 500))


def _text(table: Table, k: int, system: str) -> str:
    if not table.ok[k]:
        return table.error[k]
    unit = unit_system(system)["length"]
    length = table["length"][k] / factor(unit, "length")
    return f"L {length:.4f} {unit}, contraction {table['contraction'][k]:.4f}"


def _save(path: Path, image: Image) -> Path:
    from PIL import Image as Pictures

    Pictures.fromarray(image).save(path, quality=_JPEG)
    return path


@dataclass(frozen=True)
class Tile:
    """One picture of a contact sheet.

    Args:
        image: RGB, shape (h, w, 3); None where the file cannot be read.
        title: below it, the file's name.
        text: below the title, what was measured or what was wrong.
        ok: whether it was measured.
    """

    image: Image | None
    title: str
    text: str
    ok: bool


def contact_sheet(tiles: Sequence[Tile], columns: int | None = None) -> Image:
    """The pictures side by side in a frame that says whether each was measured.

    Args:
        tiles: the pictures, at least one.
        columns: number of them; about as many as rows if None.

    Returns:
        RGB, dtype uint8.
    """
    from PIL import Image as Pictures, ImageDraw

    across = columns or math.ceil(math.sqrt(len(tiles)))
    down = math.ceil(len(tiles) / across)
    texts = [[_shortened(tile.title, _LETTERS), *_wrapped(tile.text)] for tile in tiles]
    height = _FACE + _LINE * max(map(len, texts)) + 4
    size = across * (_FACE + _GAP) + _GAP, down * (height + _GAP) + _GAP
    sheet = Pictures.new("RGB", size, _PAPER)
    pen = ImageDraw.Draw(sheet)
    for k, (tile, text) in enumerate(zip(tiles, texts, strict=True)):
        row, column = divmod(k, across)
        top, left = _GAP + row * (height + _GAP), _GAP + column * (_FACE + _GAP)
        if tile.image is None:
            face = Pictures.new("RGB", (_FACE, _FACE), _UNREADABLE)
        else:
            face = Pictures.fromarray(tile.image)
            face.thumbnail((_FACE, _FACE))
        sheet.paste(face, (left + (_FACE - face.width) // 2, top))
        frame = left, top, left + _FACE - 1, top + _FACE - 1
        pen.rectangle(frame, outline=_GOOD if tile.ok else _BAD, width=2)
        for line, words in enumerate(text):
            ink = _INK if line == 0 or tile.ok else _BAD
            pen.text((left + 2, top + _FACE + 3 + _LINE * line), words, ink)
    return np.array(sheet)


def _wrapped(text: str) -> list[str]:
    """What fits below a picture, its beginning and its end, where the figures are."""
    return textwrap.wrap(_shortened(text, _LINES * (_LETTERS - 6)), _LETTERS)[:_LINES] or [""]


def _shortened(text: str, letters: int) -> str:
    """Without its middle where it is too long; the font has no letters but ASCII."""
    plain = text.encode("ascii", "replace").decode()
    half = (letters - 3) // 2
    return plain if len(plain) <= letters else f"{plain[:half]}...{plain[-half:]}"


def plot_table(table: Table, system: str = "us", limits: QualityLimits | None = None) -> Figure:
    """Profiles coloured by contraction, length and mean diameter over time, and quality.

    Of one picture there is the profile and the quality. Where the braid angle was measured, its
    profiles are there, too, with the error's band of a single picture, and its mean over time.

    Args:
        table: of a campaign.
        system: "us", "metric" or "si".
        limits: of the recipe, over which the quality is drawn; the usual ones if None.

    Returns:
        A figure, not shown; save it with `savefig`. Pictures that failed are marked below the
        quality.
    """
    unit = unit_system(system)["length"]
    per_unit = factor(unit, "length")
    braided = "braid_angle_deg" in table.columns
    if len(table) == 1:
        figure = Figure(figsize=(16.5 if braided else 11, 4))
        profiles, quality, *angles = figure.subplots(
            1, 3 if braided else 2, gridspec_kw=_MARGINS | {"top": 0.9, "bottom": 0.14}
        )
    else:
        figure = Figure(figsize=(11, 12 if braided else 8))
        (profiles, length), (quality, diameter), *more = figure.subplots(
            3 if braided else 2, 2, gridspec_kw=_MARGINS
        )
        _draw_over_time(length, table, "length", unit, per_unit)
        _draw_over_time(diameter, table, "mean_diameter", unit, per_unit)
        angles = [axes for row in more for axes in row]
    if angles:
        _draw_angles(angles[0], table, unit, per_unit)
    if len(angles) > 1:
        _draw_over_time(angles[1], table, "braid_angle_deg", "deg", 1.0)
    FigureCanvasAgg(figure)
    _draw_profiles(figure, profiles, table, unit, per_unit)
    _draw_quality(quality, table, limits or QualityLimits())
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_profiles(figure: Figure, axes: Axes, table: Table, unit: str, per_unit: float) -> None:
    axes.set(xlabel=f"z, {unit}", ylabel=f"D, {unit}", title="profiles")
    if not table.ok.any():
        axes.text(0.5, 0.5, "no picture was measured", transform=axes.transAxes, ha="center")
        return
    span = _draw_lines(axes, table, table.diameter / per_unit, per_unit)
    if len(table) > 1:
        figure.colorbar(ScalarMappable(span, _COLOURS), ax=axes, label="contraction")


def _draw_angles(axes: Axes, table: Table, unit: str, per_unit: float) -> None:
    axes.set(xlabel=f"z, {unit}", ylabel="braid angle, deg", title="braid angle")
    _draw_lines(axes, table, table.braid_angle, per_unit)
    if len(table) == 1:
        z = table.position * table["length"][0] / per_unit
        angle, stderr = table.braid_angle[0], table.braid_angle_stderr[0]
        axes.fill_between(z, angle - 2 * stderr, angle + 2 * stderr, alpha=0.3, lw=0)


def _draw_lines(axes: Axes, table: Table, profiles: np.ndarray, per_unit: float) -> Normalize:
    """Profiles over z, coloured by contraction."""
    good = np.flatnonzero(table.ok)
    contraction = table["contraction"]
    ordered = good[np.argsort(contraction[good])]
    chosen = ordered[np.linspace(0, len(ordered) - 1, min(len(ordered), _PROFILES)).astype(int)]
    span = Normalize(float(contraction[good].min()), float(contraction[good].max()) + 1e-9)
    for k in chosen:
        z = table.position * table["length"][k]
        axes.plot(z / per_unit, profiles[k], color=_COLOURS(span(contraction[k])), lw=0.8)
    return span


def _draw_over_time(axes: Axes, table: Table, name: str, unit: str, per_unit: float) -> None:
    axes.set(title=name.replace("_", " "), ylabel=unit)
    stamped = table.ok.any() and np.isfinite(table["time"][table.ok]).all()
    axes.set(xlabel="time, s" if stamped else "picture")
    if name not in table.columns:
        return
    at = table["time"] if stamped else np.arange(len(table))
    spread = table[f"{name}_stderr"] / per_unit
    axes.errorbar(at, table[name] / per_unit, spread, fmt=".", ms=3, lw=0.6, color="C0")


def _draw_quality(axes: Axes, table: Table, limits: QualityLimits) -> None:
    axes.set(title="quality, each figure over its limit", xlabel="picture", ylim=(0, 1))
    for name in _QUALITY:
        if name in table.columns and np.isfinite(table[name]).any():
            over = table[name] / getattr(limits, name)
            axes.plot(np.arange(len(table)), over, ".-", lw=0.6, ms=2, label=name.replace("_", " "))
    failed = np.flatnonzero(~table.ok)
    if len(failed):
        axes.plot(failed, np.zeros(len(failed)), "x", color="C3", label="failed", clip_on=False)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(frameon=False, fontsize=8)


REFERENCE_FRAME = (5568, 3712)
"""Width and height [px] of the frames of the reference work's camera."""

_SCALE = re.compile(r"\s*([\d.]+)\s*(?:\+-\s*([\d.eE+-]+))?\s*(px/[a-z]+)\s*")

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
"""Files of a folder that are taken for pictures."""


def expand(photos: Sequence[str], without: str | None = None) -> list[str]:
    """The pictures that files, folders and globs name, those of one folder in natural order.

    Args:
        photos: what was named.
        without: a picture that is not one of them, the ruler's.

    Raises:
        ImagingError: something named holds no picture.
    """
    found: list[str] = []
    for photo in photos:
        if os.path.isdir(photo):
            inside = [entry.path for entry in os.scandir(photo)
                      if entry.is_file() and entry.name.lower().endswith(SUFFIXES)]  # fmt: skip
        elif os.path.exists(photo):
            inside = [photo]
        else:
            inside = [name for name in glob.glob(photo, recursive=True) if os.path.isfile(name)]
        if not inside:
            raise ImagingError(
                f"{photo} is no file, no folder with pictures ({' '.join(SUFFIXES)}) and no pattern "
                "that matches any"
            )
        found += sorted(inside, key=_natural)
    return [path for path in found if without is None or not os.path.samefile(path, without)]


def _natural(path: str) -> list[tuple[int, str]]:
    """img2 before img10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path)]


def picture_recipe(
    *,
    ruler: Path | None,
    recipe: Path | None,
    scale: str | None,
    reading: Mapping[str, Any],
    choices: Mapping[str, Any],
) -> tuple[Recipe, dict[str, str]]:
    """The recipe for some pictures, and what their table shall say of its origin.

    Args:
        ruler: photograph of a ruler; None without one.
        recipe: file that says what else is to be done; None for the standard.
        scale: by hand, as `parse_scale` reads it; None if the ruler or the file tells it.
        reading: how the ruler is read, fields of `imaging.RulerReading` in SI.
        choices: fields of `imaging.Recipe` in SI, before those of the file.

    Raises:
        ImagingError: no scale or two, or a choice that makes no recipe.
    """
    if reading and ruler is None:
        raise ImagingError(
            "pitch, expected scale and ruler placement say how a ruler is read; there is no ruler"
        )
    fields = dict(choices)
    base = None if recipe is None else read_recipe(recipe)
    provenance = {} if recipe is None else {"recipe_file": str(recipe)}
    if "crop_offset" in fields and "frame_size" not in fields and base is None:
        fields["frame_size"] = REFERENCE_FRAME
        provenance["frame_size"] = (
            "assumed: {} x {} px, the reference work's camera; say --frame-size for another"
        ).format(*REFERENCE_FRAME)
    if ruler is not None and scale is not None:
        raise ImagingError("the scale is given twice, by ruler and by number; keep one")
    if scale is not None:
        fields["scale"] = parse_scale(scale)
    elif base is None and ruler is None:
        raise ImagingError(
            "the scale is needed: give the photograph of a ruler, a number such as "
            "226.63+-0.02 px/in, or a recipe that has one"
        )
    elif base is None:
        fields["scale"] = Scale.manual(1.0)  # until the ruler is read
    try:
        found = Recipe(**fields) if base is None else dataclasses.replace(base, **fields)
        if ruler is not None:
            found = dataclasses.replace(found, ruler=dataclasses.replace(found.ruler, **reading))
            found = dataclasses.replace(found, scale=_ruler_scale(ruler, found))
            read = dataclasses.replace(found.ruler, pitch=found.scale.pitch)
            found = dataclasses.replace(found, ruler=read)
            digest = hashlib.sha256(ruler.read_bytes()).hexdigest()
            provenance |= {"ruler": str(ruler), "ruler_sha256": digest}
    except ImagingError:
        raise
    except ValueError as error:
        raise ImagingError(f"the options do not make a recipe: {error}") from None
    return found, provenance


def parse_scale(text: str) -> Scale:
    """A scale by hand. Without `+-` its standard error is that of rounding to the digits given.

    >>> round(parse_scale("226.63 px/in").stderr * 0.0254, 6)
    0.002887
    """
    match = _SCALE.fullmatch(text)
    if match is None:
        raise ImagingError(
            f"a scale is a number with its error and unit, 226.63+-0.02 px/in, got {text!r}"
        )
    number, stderr, unit = match.groups()
    if stderr is None:
        decimals = len(number.partition(".")[2])
        stderr = str(10.0**-decimals / math.sqrt(12))
    px_per_m = parse_quantity(f"{number} {unit}", "scale")
    return Scale.manual(px_per_m, parse_quantity(f"{stderr} {unit}", "scale"))


def _ruler_scale(ruler: Path, recipe: Recipe) -> Scale:
    """The scale of the ruler, photographed as the muscle was, or in the whole frame."""
    image = read_image(ruler)
    height, width = image.shape[:2]
    whole = (width, height) == recipe.frame_size
    try:
        return calibrate_ruler(
            image,
            **dataclasses.asdict(recipe.ruler),
            distance=recipe.camera_distance,
            centre=None if whole else recipe.camera(width, height).centre,
            k1=recipe.k1,
            tone=recipe.tone_curve,
        )
    except ImagingError as error:
        raise error.at(ruler) from None


@dataclasses.dataclass(frozen=True)
class CampaignOutcome:
    """The result of a campaign.

    Args:
        table: of the pictures.
        files: that were written.
        complete: whether every picture was measured, and the log, if there is one, was merged.
    """

    table: Table
    files: list[Path]
    complete: bool


def measure_pictures(
    photos: Sequence[str],
    *,
    recipe: Recipe,
    provenance: dict[str, str],
    add_log: Callable[[Table], Table] | None = None,
    rest_length: float | None = None,
    executor: AnyExecutor | Literal["auto"] = "auto",
    system: str = "us",
    output: Path = Path("famjax-measure"),
    resume: bool = True,
    overlays: int = 12,
    progress: Callable[[int, int], None] | None = None,
) -> CampaignOutcome:
    """Measure the pictures; write table, recipe and check pictures.

    Args:
        photos: files, folders and globs.
        recipe: see `picture_recipe`.
        provenance: see `process`; the picture named as `ruler` in it is not measured.
        add_log: adds what a test machine's log says of each picture, as columns with `log_time`.
        rest_length: [m]; the longest measured picture if None.
        executor: as of `process`.
        system: units of CSV and plots.
        output: folder, made if need be.
        resume: continue from the results in the folder.
        overlays: number of check pictures.
        progress: called with (pictures done, pictures).

    Raises:
        ImagingError: input that cannot be used.
    """
    paths = expand(photos, without=provenance.get("ruler"))
    table = process(
        paths,
        recipe,
        output,
        resume=resume,
        progress=progress,
        executor=executor,
        rest_length=rest_length,
        provenance=provenance,
    )
    merged = table if add_log is None else add_log(table)
    try:
        files = [
            merged.write_csv(output / "measurements.csv", system),
            merged.write_netcdf(output / "measurements.nc"),
            write_recipe(recipe, output / "recipe.toml"),
            *write_check_pictures(merged, recipe, output, overlays, system),
        ]
    except OSError as error:
        raise ImagingError(f"a file cannot be written: {error}", path=output) from None
    complete = bool(table.ok.all()) and (add_log is None or "log_time" in merged.columns)
    return CampaignOutcome(merged, files, complete)


def as_document(outcome: CampaignOutcome, system: str) -> dict[str, Any]:
    """For JSON: what is not known is null."""
    table = outcome.table
    columns = {column_name(name, system): table.in_units(name, system) for name in table.columns}
    return {
        "pictures": len(table),
        "ok": int(table.ok.sum()),
        "complete": outcome.complete,
        "notes": list(table.notes),
        "files": [str(path) for path in outcome.files],
        "rows": [
            {
                "path": path,
                "ok": not table.error[k],
                "error": table.error[k],
                "warnings": table.warnings[k] if table.warnings else "",
            }
            | {name: finite_or_none(values[k]) for name, values in columns.items()}
            for k, path in enumerate(table.path)
        ],
    }
