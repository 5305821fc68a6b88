"""From file names to a folder of results: recipe, campaign, and pictures for a visual check."""

import dataclasses
import glob
import hashlib
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from famjax.boundary.files import check_output
from famjax.boundary.tasks import AnyExecutor
from famjax.boundary.units import parse_quantity

from .camera import Indices, Scale
from .campaign import Table, process
from .errors import ImagingError, MixedSizes, ScaleContradiction
from .measurement import draw_overlay, measure
from .photograph import HEIC, read_image, sizes_of
from .recipe import Recipe, read_recipe, write_recipe
from .ruler import calibrate_ruler

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", *HEIC)
"""Files of a folder that are taken for pictures."""

_SCALE = re.compile(r"\s*([\d.]+)\s*(?:\+-\s*([\d.eE+-]+))?\s*(px/[a-z]+)\s*")


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
            inside = [entry.path for entry in os.scandir(photo) if _is_picture(entry)]
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


def _is_picture(entry: os.DirEntry[str]) -> bool:
    # macOS writes ._name beside each name on disks that are not its own.
    return (
        entry.is_file()
        and entry.name.lower().endswith(SUFFIXES)
        and not entry.name.startswith("._")
    )


def _natural(path: str) -> list[tuple[int, str]]:
    """img2 before img10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path)]


def skipped(photos: Sequence[str]) -> list[str]:
    """Names of the files in the given folders that are not pictures."""
    folders = [photo for photo in photos if os.path.isdir(photo)]
    files = [entry for folder in folders for entry in os.scandir(folder) if entry.is_file()]
    return sorted(entry.name for entry in files if not _is_picture(entry))


def picture_recipe(
    *, ruler: Path | None, recipe: Path | None, scale: str | None, reading: Mapping[str, Any],
    choices: Mapping[str, Any],
) -> tuple[Recipe, dict[str, str]]:  # fmt: skip
    """The recipe for some pictures, and the origin of its entries for their table.

    Args:
        ruler: photograph of a ruler; None without one.
        recipe: file that says what else is to be done; None for the standard.
        scale: by hand, as `parse_scale` reads it; None if the ruler or the file tells it.
        reading: how the ruler is read, arguments of `imaging.calibrate_ruler`.
        choices: fields of `imaging.Recipe` in SI, before those of the file.

    Raises:
        ImagingError: no scale or two, or a choice that makes no recipe.
    """
    if reading and ruler is None:
        raise ImagingError(
            "pitch, expected scale and ruler placement say how a ruler is read; there is no ruler"
        )
    if ruler is not None and scale is not None:
        raise ImagingError("the scale is given twice, by ruler and by number; keep one")
    fields = dict(choices)
    base = None if recipe is None else read_recipe(recipe)
    provenance = {} if recipe is None else {"recipe_file": str(recipe)}
    if scale is not None:
        fields["scale"] = parse_scale(scale)
    elif base is None and ruler is None:
        raise ImagingError(
            "the scale is needed: give the photograph of a ruler, a number such as "
            "226.63+-0.02 px/in, or a recipe that has one"
        )
    elif base is None:
        fields["scale"] = Scale.manual(1.0)  # until the ruler is read
    found = Recipe(**fields) if base is None else dataclasses.replace(base, **fields)
    if ruler is not None:
        found = dataclasses.replace(found, scale=_ruler_scale(ruler, found, reading))
        digest = hashlib.sha256(ruler.read_bytes()).hexdigest()
        provenance |= {"ruler": str(ruler), "ruler_sha256": digest}
    return found, provenance


def parse_scale(text: str) -> Scale:
    """Parse a scale. Without `+-` its standard error is that of rounding to the given digits.

    >>> round(parse_scale("226.63 px/in").stderr * 0.0254, 6)
    0.002887
    """
    match = _SCALE.fullmatch(text)
    if match is None:
        raise ImagingError(
            f"a scale is a number with its error and unit, 226.63+-0.02 px/in, got {text!r}"
        )
    number, stderr, unit = match.groups()
    stderr = stderr or str(10.0 ** -len(number.partition(".")[2]) / math.sqrt(12))
    px_per_m, error = (parse_quantity(f"{one} {unit}", "scale") for one in (number, stderr))
    return Scale.manual(px_per_m, error)


def _ruler_scale(ruler: Path, recipe: Recipe, reading: Mapping[str, Any]) -> Scale:
    """The scale of the ruler, photographed as the muscle was, or in the whole frame."""
    image = read_image(ruler)
    height, width = image.shape[:2]
    whole = (width, height) == recipe.frame_size
    try:
        return calibrate_ruler(
            image, **reading, distance=recipe.camera_distance,
            centre=None if whole else recipe.camera(width, height).centre, k1=recipe.k1,
            tone=recipe.tone_curve,
        )  # fmt: skip
    except ImagingError as error:
        raise error.at(ruler) from None


def check_sizes(ruler: str, paths: Sequence[str], recipe: Recipe) -> None:
    """Refuse a ruler's picture that is cropped or scaled differently from those of the muscle.

    A ruler in the whole frame serves pictures that the recipe says to be cropped from it.

    Raises:
        MixedSizes: other pixels, or other ones as the camera took them.
    """
    others = next((sizes for path in paths if (sizes := sizes_of(path))), [])
    for one, other in zip(sizes_of(ruler), others, strict=False):
        if one not in (other, recipe.frame_size):
            raise MixedSizes(
                f"the ruler's picture has {one[0]} x {one[1]} px, those of the muscle {other[0]} x "
                f"{other[1]}, by file or camera, a ratio of {one[0] / other[0]:.4g} in width and "
                f"{one[1] / other[1]:.4g} in height. They must be cropped and scaled alike: say how the "
                "pictures were cropped (--crop-offset, --frame-size), or that it is meant (--rescaled)",
                path=ruler,
            )


def check_known_sizes(table: Table, rest_length: float | None, diameter: float | None) -> None:
    """Refuse a scale with which no muscle could have the sizes that are known of it.

    A muscle contracts by less than half of its rest length, and is hardly ever longer; it swells to twice
    its nominal diameter at most.

    Args:
        table: of the pictures.
        rest_length: L0 [m]; None where it is not known.
        diameter: nominal, of the braid at rest [m]; None where it is not known.

    Raises:
        ScaleContradiction: names the size that the pictures contradict.
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
                f"the pictures show {low:.3g} to {high:.3g} times the {name} of {known * 1e3:.5g} mm, and "
                f"a muscle has {least} to {most} times: correct the {name}, or the scale; is the pitch of "
                "the ruler right, and were all pictures taken and kept at one size?"
            )


class CampaignOutcome(NamedTuple):
    """The result of a campaign.

    Attributes:
        table: of the pictures.
        files: that were written.
        complete: whether every picture was measured, and the log, if there is one, was merged.
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
    """Measure the pictures; write table, recipe and check pictures.

    Args:
        photos: files, folders and globs.
        recipe: see `picture_recipe`.
        provenance: see `process`; the picture named as `ruler` in it is not measured.
        add_log: adds what a test machine's log says of each picture, as columns with `log_time`.
        rest_length: [m]; the longest measured picture if None.
        executor: as of `process`.
        system: units of CSV and plots.
        output: folder, created if missing; what was measured there in the same way is taken from it.
        overlays: number of pictures drawn with what was found in them.
        rescaled: that the ruler's picture has another size than the others is meant.
        diameter: nominal diameter of the braid at rest, against which the scale is checked [m].
        progress: called with (pictures done, pictures).

    Raises:
        ImagingError: input that cannot be used.
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
    if others := skipped(photos):
        note = f"{len(others)} files are no pictures by their names and were skipped, {others[0]} first."
        table = dataclasses.replace(table, notes=(*table.notes, note))
    if add_log is not None:
        table = add_log(table)
    files = [
        table.write_csv(output / "measurements.csv", system),
        table.write_netcdf(output / "measurements.nc"),
        write_recipe(recipe, output / "recipe.toml"),
        draw_overlays(table, recipe, output / "overlays", overlays),
    ]
    complete = bool(table.ok.all()) and (add_log is None or "log_time" in table.columns)
    return CampaignOutcome(table, files, complete)


def as_document(outcome: CampaignOutcome, system: str) -> dict[str, Any]:
    """For JSON: unknown values are null."""
    table = outcome.table
    return {
        "pictures": len(table),
        "ok": int(table.ok.sum()),
        "complete": outcome.complete,
        "notes": list(table.notes),
        "files": [str(path) for path in outcome.files],
        "rows": table.rows(system),
    }


def by_contraction(table: Table, number: int) -> Indices:
    """A number of measured pictures, evenly spaced in contraction, the longest muscle first."""
    good = np.flatnonzero(table.ok)
    ordered = good[np.argsort(table["contraction"][good])]
    at = np.linspace(0, good.size - 1, min(number, good.size))
    return ordered[np.round(at).astype(int)]


def draw_overlays(table: Table, recipe: Recipe, folder: Path, number: int) -> Path:
    """Draw the found outlines into some pictures, which are measured again; returns their folder."""
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    for k in by_contraction(table, number).tolist():
        path = Path(table.path[k])
        image = read_image(path)
        drawn = draw_overlay(image, measure(image, recipe).trace)
        Image.fromarray(drawn).save(folder / f"{k + 1:06d}_{path.stem}.jpg", quality=95)
    return folder
