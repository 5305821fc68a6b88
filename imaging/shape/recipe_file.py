"""A recipe as a TOML file: every choice in it, units in the keys, back to the same bits."""

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from famjax.boundary.toml_file import Form, from_entries, read_toml, to_entries, toml_text

from ..camera.tone import Tone
from ..errors import ImagingError
from ..recipe import Recipe

_FORMAT = "famjax recipe 1"


def _tone_entry(tone: Tone) -> Any:
    return "srgb" if tone == Tone.srgb() else tone.table.tolist()


def _tone(entry: Any) -> Tone:
    return Tone.srgb() if entry == "srgb" else Tone(np.array(entry, float))


_FORM = Form(
    kinds=dict.fromkeys(("distance", "tape_diameter", "pitch", "placement_stderr"), "length"),
    keys={"tape_hue": "tape_hue_deg", "stderr": "stderr_px_per_m"},
    codecs={Tone: (_tone_entry, _tone)},
)


def recipe_as_dict(recipe: Recipe) -> dict[str, Any]:
    """All choices of a recipe in SI, of types that TOML and JSON know.

    A field that is None is left out if that is its default, and "none" if it is not.
    """
    return {"format": _FORMAT, **to_entries(recipe, _FORM)}


def recipe_from_dict(entries: Mapping[str, Any], path: str | Path | None = None) -> Recipe:
    """The recipe of such entries; lengths may have any known unit, `distance_in = 60`.

    Args:
        entries: keys and values.
        path: of their file, for errors.

    Raises:
        ImagingError: an unknown key, unit or format, a missing scale, or a value that cannot be.
    """
    error = functools.partial(ImagingError, path=path)
    given = dict(entries)
    found = given.pop("format", _FORMAT)
    if found != _FORMAT:
        raise error(f"a recipe has the format {_FORMAT!r}, got {found!r}")
    return from_entries(Recipe, given, _FORM, error=error)


def recipe_text(recipe: Recipe) -> str:
    """The TOML text of a recipe."""
    return toml_text(recipe_as_dict(recipe))


def write_recipe(recipe: Recipe, path: str | Path) -> Path:
    """Write a recipe that `read_recipe` reads back to the same bits.

    Raises:
        ImagingError: the file cannot be written.
    """
    path = Path(path)
    try:
        path.write_text(recipe_text(recipe), encoding="utf-8")
    except OSError as error:
        raise ImagingError(f"the recipe cannot be written: {error}", path=path) from None
    return path


def read_recipe(path: str | Path) -> Recipe:
    """The recipe in a TOML file.

    Raises:
        ImagingError: no such file, not TOML, an unknown key or unit, or a value that cannot be.
    """
    error = functools.partial(ImagingError, path=path)
    return recipe_from_dict(read_toml(path, "recipe", error, where=""), path)
