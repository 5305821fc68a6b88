"""How the pictures of one camera are measured: a recipe with the scale of its ruler, and its origin."""

import dataclasses
import hashlib
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from famjax.boundary.units import parse_quantity
from imaging import ImagingError, Recipe, Scale, calibrate_ruler, read_image, read_recipe

REFERENCE_FRAME = (5568, 3712)
"""Width and height [px] of the frames of the reference work's camera."""

_SCALE = re.compile(r"\s*([\d.]+)\s*(?:\+-\s*([\d.eE+-]+))?\s*(px/[a-z]+)\s*")


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
