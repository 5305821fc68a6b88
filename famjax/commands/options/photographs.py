"""The options of `famjax measure`: pictures, and the recipe by which to measure them."""

from collections.abc import Callable
from typing import Any

from famjax.boundary.units import factor, parse_quantity
from famjax.chain import picture_recipe
from imaging import ImagingError, Recipe, Tone

from .recipe import RecipeOptions


def command_recipe(options: RecipeOptions) -> tuple[Recipe, dict[str, str]]:
    """The recipe of the options, and what the table shall say of its origin.

    Args:
        options: which override those of a recipe's file. A `scale` is `226.63 px/in` or
            `226.63+-0.02 px/in`; lengths have their unit.

    Raises:
        ImagingError: no scale or two, or an option that cannot be read.
    """
    reading: dict[str, Any] = {}
    if options.pitch is not None:
        reading["pitch"] = _length(options.pitch, "pitch")
    if options.expected_px_per_in is not None:
        reading["expected_px_per_m"] = options.expected_px_per_in * factor("px/in", "scale")
    if options.ruler_placement is not None:
        reading["placement_stderr"] = parse_quantity(options.ruler_placement, "length")
    choices = {
        name: read(text, name)
        for name, read in _READ.items()
        if (text := getattr(options, name)) is not None
    }
    return picture_recipe(
        ruler=options.ruler, recipe=options.recipe, scale=options.scale, reading=reading,
        choices=choices,
    )  # fmt: skip


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
    "braid_angle": lambda given, _: given,
    "n_threads": lambda given, _: given,
    "turns": lambda given, _: given,
    "orientation": lambda text, _: text,
}
