"""The options of `famjax measure`: pictures, and the recipe by which to measure them."""

import dataclasses
import hashlib
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from famjax.boundary.units import factor, parse_quantity
from imaging import ImagingError, Recipe, Scale, calibrate_ruler, read_image, read_recipe
from imaging.camera import Tone

from .recipe import RecipeOptions

REFERENCE_FRAME = (5568, 3712)
"""Width and height [px] of the frames of the reference work's camera."""

_SCALE = re.compile(r"\s*([\d.]+)\s*(?:\+-\s*([\d.eE+-]+))?\s*(px/[a-z]+)\s*")


def command_recipe(options: RecipeOptions) -> tuple[Recipe, dict[str, str]]:
    """The recipe of the options, and what the table shall say of its origin.

    Args:
        options: which override those of a recipe's file. A `scale` is `226.63 px/in` or
            `226.63+-0.02 px/in`; lengths have their unit.

    Raises:
        ImagingError: no scale or two, or an option that cannot be read.
    """
    recipe, ruler, scale = options.recipe, options.ruler, options.scale
    reading: dict[str, Any] = {}
    if options.pitch is not None:
        reading["pitch"] = _length(options.pitch, "pitch")
    if options.expected_px_per_in is not None:
        reading["expected_px_per_m"] = options.expected_px_per_in * factor("px/in", "scale")
    if options.ruler_placement is not None:
        reading["placement_stderr"] = parse_quantity(options.ruler_placement, "length")
    if reading and ruler is None:
        raise ImagingError(
            "pitch, expected scale and ruler placement say how a ruler is read; there is no ruler"
        )
    choices: dict[str, Any] = {
        name: read(text, name)
        for name, read in _READ.items()
        if (text := getattr(options, name)) is not None
    }
    base = None if recipe is None else read_recipe(recipe)
    provenance = {} if recipe is None else {"recipe_file": str(recipe)}
    if "crop_offset" in choices and "frame_size" not in choices and base is None:
        choices["frame_size"] = REFERENCE_FRAME
        provenance["frame_size"] = (
            "assumed: {} x {} px, the reference work's camera; say --frame-size for another"
        ).format(*REFERENCE_FRAME)
    if ruler is not None and scale is not None:
        raise ImagingError("the scale is given twice, by ruler and by number; keep one")
    if scale is not None:
        choices["scale"] = parse_scale(scale)
    elif base is None and ruler is None:
        raise ImagingError(
            "the scale is needed: give the photograph of a ruler, a number such as "
            "226.63+-0.02 px/in, or a recipe that has one"
        )
    elif base is None:
        choices["scale"] = Scale.manual(1.0)  # until the ruler is read
    try:
        found = Recipe(**choices) if base is None else dataclasses.replace(base, **choices)
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


def set_up(recipe: Recipe, options: RecipeOptions, inch: bool) -> list[dict[str, str]]:
    """What the figures rest on: each choice of the set-up, its value, and where it is from.

    Args:
        recipe: of the options.
        options: as they were given.
        inch: lengths in inches, else in mm.

    Returns:
        Rows with the keys `what`, `value` and `source`, which begins with "stated", "measured" or
        "assumed".
    """
    unit, size = ("in", 0.0254) if inch else ("mm", 1e-3)
    scale, stated = recipe.scale, "stated"
    px = "measured, by the ruler" if scale.source == "ruler" else stated
    rows = [("scale", f"{scale.px_per_m * size:.6g} +- {scale.stderr * size:.2g} px/{unit}", px)]
    if recipe.distance is None:
        rows.append(
            (
                "distance",
                "see each picture",
                "measured, by the arcs of the tapes' edges: say --distance",
            )
        )
    else:
        rows.append(("distance", f"{recipe.distance / size:.5g} {unit}", stated))
    if scale.source == "ruler":
        given = options.pitch is not None or (options.recipe is not None and not options.ruler)
        read = stated if given else "measured, by the marks from number to number"
        if scale.pitch is not None:
            rows.append(("pitch of the ruler", f"{scale.pitch / size:.5g} {unit}", read))
        placed = scale.placement_stderr
        rows.append(
            ("place of the ruler", "in the plane of the axis", "assumed: say --ruler-placement")
            if placed is None
            else ("place of the ruler", f"+-{placed / size:.3g} {unit} off the axis", stated)
        )
    lens = "assumed: say --k1" if recipe.scale.k1_stderr is None else "measured, by the ruler"
    rows.append(("k1 of the lens", f"{recipe.lens_k1:.3g}", lens if recipe.k1 is None else stated))
    tone = "assumed, another is in the errors: say --tone srgb" if recipe.tone is None else stated
    curve = "sRGB" if recipe.tone_curve == Tone.srgb() else "of the recipe"
    rows.append(("tone curve", curve, tone))
    return [dict(zip(("what", "value", "source"), row, strict=True)) for row in rows]


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


def _length(text: str, name: str) -> float:
    value = parse_quantity(text, "length")
    if not value > 0:
        raise ImagingError(f"the {name.replace('_', ' ')} must be above zero, got {text!r}")
    return value


def _pair(text: str, name: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        raise ImagingError(
            f"the {name.replace('_', ' ')} is two numbers in px, 1459,531, got {text!r}"
        ) from None
    return first, second


def _whole_pair(text: str, name: str) -> tuple[int, int]:
    first, second = _pair(text, name)
    if not (first.is_integer() and second.is_integer()):
        raise ImagingError(f"the {name.replace('_', ' ')} is in whole px, got {text!r}")
    return int(first), int(second)


def _angle(text: str, name: str) -> float:
    try:
        return float(text.removesuffix("deg"))
    except ValueError:
        raise ImagingError(
            f"the {name.replace('_', ' ')} is an angle, 355deg, got {text!r}"
        ) from None


_READ: dict[str, Callable[[Any, str], Any]] = {
    "distance": _length,
    "tape_diameter": _length,
    "crop_offset": _pair,
    "frame_size": _whole_pair,
    "tape_hue": _angle,
    "k1": lambda k1, _: float(k1),
    "tone": lambda _text, _: Tone.srgb(),
    "method": lambda text, _: text,
    "braid_angle": lambda given, _: given,
    "n_threads": lambda given, _: given,
    "turns": lambda given, _: given,
    "orientation": lambda text, _: text,
}
