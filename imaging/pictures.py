"""From files by their names to a folder of results: pictures, recipe with its ruler's scale, campaign."""

import dataclasses
import glob
import hashlib
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from famjax.boundary.tasks import AnyExecutor
from famjax.boundary.units import finite_or_none, parse_quantity

from .camera import Scale
from .campaign import Table, column_name, process
from .check_pictures import write_check_pictures
from .errors import ImagingError
from .photograph import read_image
from .recipe import Recipe, read_recipe, write_recipe
from .ruler import calibrate_ruler

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
