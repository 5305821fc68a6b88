"""Measure the pictures in files and folders, and write the results."""

import dataclasses
import glob
import hashlib
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from famjax.boundary.files import check_output
from famjax.boundary.tasks import AnyExecutor
from famjax.boundary.units import parse_quantity

from .camera import Scale
from .campaign import Table, process
from .errors import ImagingError, MixedSizes, ScaleContradiction
from .measurement import draw_overlay, measure
from .photograph import HEIC, read_image, sizes_of
from .recipe import Recipe, write_recipe
from .ruler import calibrate_ruler

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", *HEIC)
"""Suffixes by which pictures are recognised in a folder."""

_OF_RULER = ("pitch", "placement_stderr")
_SCALE = re.compile(r"\s*([\d.]+)\s*(?:\+-\s*([\d.eE+-]+))?\s*(px/[a-z]+)\s*")


def expand(photos: Sequence[str], without: str | None = None) -> list[str]:
    """Return the pictures that match files, folders and patterns, with each folder in natural order.

    Args:
        photos: files, folders and patterns.
        without: picture to exclude, such as the ruler's.

    Raises:
        ImagingError: an entry matches no picture.
    """
    found: list[str] = []
    for photo in photos:
        if os.path.isdir(photo):
            inside = [entry.path for entry in os.scandir(photo) if _is_picture(entry)]
        elif os.path.exists(photo):
            inside = [photo]
        else:
            inside = [name for name in glob.glob(photo, recursive=True) if os.path.isfile(name)]
        if not inside:
            raise ImagingError(
                f"{photo} must be a file, a folder with pictures ({' '.join(SUFFIXES)}), or a pattern "
                "that matches at least one file"
            )
        found += sorted(inside, key=_natural)
    return [path for path in found if without is None or not os.path.samefile(path, without)]


def _is_picture(entry: os.DirEntry[str]) -> bool:
    # macOS adds a file ._name for each file on foreign file systems.
    return (
        entry.is_file()
        and entry.name.lower().endswith(SUFFIXES)
        and not entry.name.startswith("._")
    )


def _natural(path: str) -> list[tuple[int, str]]:
    """Sort key that places img2 before img10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path)]


def skipped(photos: Sequence[str]) -> list[str]:
    """Return the names of files in the given folders that are not pictures."""
    folders = [photo for photo in photos if os.path.isdir(photo)]
    files = [entry for folder in folders for entry in os.scandir(folder) if entry.is_file()]
    return sorted(entry.name for entry in files if not _is_picture(entry))


def picture_recipe(
    ruler: Path | None, scale: str | None, choices: Mapping[str, Any]
) -> tuple[Recipe, dict[str, str]]:
    """Build a recipe, and the provenance entries for the table.

    Args:
        ruler: photograph of a ruler, if any.
        scale: manual scale, see `parse_scale`; None to use the ruler.
        choices: fields of `imaging.Recipe`, and pitch and placement_stderr of `imaging.calibrate_ruler`,
            all in SI.

    Raises:
        ImagingError: the scale is missing or stated twice, or a choice is invalid.
    """
    reading = {name: choices[name] for name in _OF_RULER if name in choices}
    choices = {name: one for name, one in choices.items() if name not in reading}
    if reading and ruler is None:
        raise ImagingError(
            "pitch and ruler placement require a ruler: provide a photograph of it (--ruler)"
        )
    if (ruler is None) == (scale is None):
        raise ImagingError(
            "the scale must be stated exactly once, either by a photograph of a ruler (--ruler) or by a "
            "number (--scale), such as 226.63+-0.02 px/in"
        )
    recipe = Recipe(Scale.manual(1.0) if scale is None else parse_scale(scale), **choices)
    if ruler is None:
        return recipe, {}
    image = read_image(ruler)
    # The ruler's picture may be cropped like the others, or show the whole frame.
    height, width = image.shape[:2]
    whole = (width, height) == recipe.frame_size
    try:
        found = calibrate_ruler(
            image, **reading, distance=recipe.camera_distance,
            centre=None if whole else recipe.camera(width, height).centre, k1=recipe.k1,
            tone=recipe.tone_curve,
        )  # fmt: skip
    except ImagingError as error:
        raise error.at(ruler) from None
    digest = hashlib.sha256(ruler.read_bytes()).hexdigest()
    return dataclasses.replace(recipe, scale=found), {"ruler": str(ruler), "ruler_sha256": digest}


def parse_scale(text: str) -> Scale:
    """Parse a scale; if `+-` is missing, the standard error is the rounding error of the last digit.

    >>> round(parse_scale("226.63 px/in").stderr * 0.0254, 6)
    0.002887
    """
    match = _SCALE.fullmatch(text)
    if match is None:
        raise ImagingError(
            f"a scale must be a number with an error and a unit, such as 226.63+-0.02 px/in; got {text!r}"
        )
    number, stderr, unit = match.groups()
    stderr = stderr or str(10.0 ** -len(number.partition(".")[2]) / math.sqrt(12))
    px_per_m, error = (parse_quantity(f"{one} {unit}", "scale") for one in (number, stderr))
    return Scale.manual(px_per_m, error)


def check_sizes(ruler: str, paths: Sequence[str], recipe: Recipe) -> None:
    """Check that the ruler's picture is cropped and scaled in the same way as those of the muscle.

    If the recipe describes the crop, a ruler picture of the whole frame is also accepted.

    Raises:
        MixedSizes: the sizes differ, in the file or as recorded by the camera.
    """
    others = next((sizes for path in paths if (sizes := sizes_of(path))), [])
    for one, other in zip(sizes_of(ruler), others, strict=False):
        if one not in (other, recipe.frame_size):
            raise MixedSizes(
                f"the ruler's picture has {one[0]} x {one[1]} px, but the muscle's pictures have "
                f"{other[0]} x {other[1]} px, a ratio of {one[0] / other[0]:.4g} in width and "
                f"{one[1] / other[1]:.4g} in height. All must be cropped and scaled alike: state the "
                "crop (--crop-offset, --frame-size), or confirm that the difference is intended "
                "(--rescaled)",
                path=ruler,
            )


def check_known_sizes(table: Table, rest_length: float | None, diameter: float | None) -> None:
    """Check the scale against the known dimensions of the muscle.

    A muscle contracts by less than half its rest length and hardly ever stretches beyond that length. Its
    diameter at most doubles.

    Args:
        table: measurements.
        rest_length: rest length L0 [m], if known.
        diameter: nominal diameter of the braid at rest [m], if known.

    Raises:
        ScaleContradiction: the measured sizes contradict a known dimension.
    """
    for name, known, column, least, most in (
        ("rest length", rest_length, "length", 0.5, 1.05),
        ("nominal diameter", diameter, "mean_diameter", 0.85, 2.2),
    ):
        if known is None or not table.ok.any():
            continue
        low, high = np.nanmin(table[column]) / known, np.nanmax(table[column]) / known
        if not least <= low <= high <= most:
            raise ScaleContradiction(
                f"the measured sizes are {low:.3g} to {high:.3g} times the {name} of {known * 1e3:.5g} mm; "
                f"for a muscle, the ratio must be {least} to {most}: correct the {name} or the scale. "
                "Check the pitch of the ruler's marks, and that no picture was resized"
            )


def _unchecked_plane(table: Table, recipe: Recipe) -> Iterator[str]:
    """Yield a note if no known size shows whether the muscle hangs in the ruler's plane."""
    if recipe.scale.source == "ruler" and recipe.tape_diameter is None and table.ok.any():
        larger = 0.01 / float(np.nanmedian(table["distance"]))
        yield (
            "The pictures do not show whether the muscle is in the ruler's plane. If it is 10 mm nearer to "
            f"the camera, all lengths are {larger:.1%} too large. To check this, specify --tape-diameter."
        )


class CampaignOutcome(NamedTuple):
    """Result of a campaign.

    Attributes:
        table: measurements.
        files: files written.
        complete: True if every picture was measured and the log, if any, was merged.
    """

    table: Table
    files: list[Path]
    complete: bool


def measure_pictures(
    photos: Sequence[str], *, recipe: Recipe, provenance: dict[str, str],
    add_log: Callable[[Table], Table] | None = None, rest_length: float | None = None,
    executor: AnyExecutor | Literal["auto"] = "auto", system: str = "us",
    output: Path = Path("famjax-measure"), overlays: int = 12,
    rescaled: bool = False, diameter: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> CampaignOutcome:  # fmt: skip
    """Measure the pictures; write the table, the recipe and the overlays.

    Args:
        photos: files, folders and patterns.
        recipe: see `picture_recipe`.
        provenance: see `process`; the picture in its `ruler` entry is not measured.
        add_log: function that adds columns from a test machine's log, including `log_time`.
        rest_length: rest length L0 [m]; None uses the longest measured length.
        executor: see `process`.
        system: units in the CSV file and plots.
        output: output folder, created if missing; finished rows in it are reused.
        overlays: number of pictures saved with the detected edges drawn on them.
        rescaled: True to accept a ruler picture that differs in size from the others.
        diameter: nominal diameter of the braid at rest, used to check the scale [m].
        progress: called with (pictures done, pictures).

    Raises:
        ImagingError: an input is invalid.
    """
    check_output(output)
    ruler = provenance.get("ruler")
    paths = expand(photos, without=ruler)
    if ruler is not None and not rescaled:
        check_sizes(ruler, paths, recipe)
    table = process(
        paths, recipe, output, executor, progress, rest_length=rest_length,
        provenance=provenance,
    )  # fmt: skip
    check_known_sizes(table, rest_length, diameter)
    told = list(_unchecked_plane(table, recipe))
    if others := skipped(photos):
        told.append(f"Skipped {len(others)} files that are not pictures; the first is {others[0]}.")
    table = dataclasses.replace(table, notes=(*table.notes, *told))
    if add_log is not None:
        table = add_log(table)
    csv = output / "measurements.csv"
    csv.write_text(table.csv_text(system), encoding="utf-8", newline="")
    files = [
        csv,
        table.write_netcdf(output / "measurements.nc"),
        write_recipe(recipe, output / "recipe.toml"),
        draw_overlays(table, recipe, output / "overlays", overlays),
    ]
    complete = bool(table.ok.all()) and (add_log is None or "log_time" in table.columns)
    return CampaignOutcome(table, files, complete)


def draw_overlays(table: Table, recipe: Recipe, folder: Path, number: int) -> Path:
    """Measure some pictures again, save them with the outlines drawn on them, and return the folder.

    The pictures are evenly spaced in contraction.
    """
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    good = np.flatnonzero(table.ok)
    good = good[np.argsort(table["contraction"][good])]
    at = np.linspace(0, good.size - 1, min(number, good.size)).round().astype(int)
    for k in good[at].tolist():
        path = Path(table.path[k])
        image = read_image(path)
        drawn = draw_overlay(image, measure(image, recipe).trace)
        Image.fromarray(drawn).save(folder / f"{k + 1:06d}_{path.stem}.jpg", quality=95)
    return folder
