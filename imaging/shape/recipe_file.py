"""A recipe as a TOML file: every choice in it, units in the keys, back to the same bits."""

import dataclasses
import math
import tomllib
import typing
from pathlib import Path
from typing import Any

import numpy as np

from famjax.boundary.units import UNITS, factor

from ..camera.tone import Tone
from ..errors import ImagingError
from ..recipe import Recipe

_FORMAT = "famjax recipe 1"
_LENGTHS = ("distance", "tape_diameter", "pitch", "placement_stderr")
_KEYS = {"tape_hue": "tape_hue_deg", "stderr": "stderr_px_per_m"}
"""Keys of the fields whose name alone does not say the unit."""


def recipe_as_dict(recipe: Recipe) -> dict[str, Any]:
    """All choices of a recipe in SI, of types that TOML and JSON know.

    A field that is None is left out if that is its default, and "none" if it is not.
    """
    return {"format": _FORMAT, **_as_dict(recipe)}


def recipe_from_dict(entries: dict[str, Any]) -> Recipe:
    """The recipe of such entries; lengths may have any known unit, `distance_in = 60`.

    Raises:
        ImagingError: an unknown key, unit or format, a missing scale, or a value of a wrong type.
    """
    given = dict(entries)
    found = given.pop("format", _FORMAT)
    if found != _FORMAT:
        raise ImagingError(f"a recipe has the format {_FORMAT!r}, got {found!r}")
    return _from_dict(Recipe, given, "")


def recipe_text(recipe: Recipe) -> str:
    """The TOML text of a recipe."""
    entries = recipe_as_dict(recipe)
    lines = [f"{key} = {_toml(value)}" for key, value in entries.items() if _plain(value)]
    for key, value in entries.items():
        if not _plain(value):
            lines += ["", f"[{key}]", *(f"{name} = {_toml(v)}" for name, v in value.items())]
    return "\n".join(lines) + "\n"


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
    try:
        entries = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ImagingError(f"the recipe cannot be read: {error.strerror}", path=path) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ImagingError(f"the recipe is not a TOML file: {error}", path=path) from None
    try:
        return recipe_from_dict(entries)
    except ImagingError as error:
        raise error.at(path) from None
    except (ValueError, TypeError) as error:
        raise ImagingError(f"the recipe cannot be used: {error}", path=path) from None


def _as_dict(part: Any) -> dict[str, Any]:
    entries = {}
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        if value is None and field.default is None:
            continue
        entries[_key(field.name)] = _encoded(value)
    return entries


def _key(name: str) -> str:
    return f"{name}_m" if name in _LENGTHS else _KEYS.get(name, name)


def _encoded(value: Any) -> Any:
    if value is None:
        return "none"
    if isinstance(value, Tone):
        return "srgb" if value == Tone.srgb() else value.table.tolist()
    if dataclasses.is_dataclass(value):
        return _as_dict(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_encoded(one) for one in value] if isinstance(value, tuple) else value


def _from_dict(kind: type, entries: dict[str, Any], place: str) -> Any:
    hints = typing.get_type_hints(kind)
    names = {_key(field.name): field.name for field in dataclasses.fields(kind)}
    values: dict[str, Any] = {}
    for key, value in entries.items():
        name, multiplier = names.get(key), 1.0
        stem, _, unit = key.rpartition("_")
        if name is None and stem in _LENGTHS and f"{stem}_m" in names:
            name, multiplier = stem, factor(unit, "length")
        if name is None:
            known = ", ".join(names)
            raise ImagingError(f"unknown key {place}{key}; known are {known} (lengths in any of "
                               f"{', '.join(UNITS['length'])})")  # fmt: skip
        if name in values:
            raise ImagingError(f"{place}{name} is given twice, in two units; keep one")
        decoded = _decoded(hints[name], value, place + key)
        values[name] = decoded * multiplier if multiplier != 1.0 else decoded
    needed = [
        _key(field.name)
        for field in dataclasses.fields(kind)
        if field.name not in values
        and field.default is dataclasses.MISSING
        and field.default_factory is dataclasses.MISSING
    ]
    if needed:
        raise ImagingError(f"the recipe lacks {', '.join(place + key for key in needed)}")
    return kind(**values)


def _decoded(hint: Any, value: Any, key: str) -> Any:
    """A value as the type that its field is annotated with."""
    kinds = typing.get_args(hint) if typing.get_origin(hint) is not typing.Literal else (hint,)
    kinds = kinds or (hint,)
    for kind in (kind for kind in (hint, *kinds) if isinstance(kind, type)):
        if kind is Tone:
            return Tone.srgb() if value == "srgb" else Tone(np.array(value, float))
        if dataclasses.is_dataclass(kind):
            if not isinstance(value, dict):
                raise ImagingError(f"{key} must be a table of the recipe, got {value!r}")
            return _from_dict(kind, value, f"{key}.")
    if value == "none" and type(None) in kinds:
        return None
    if isinstance(value, list):
        return tuple(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return float(value) if float in kinds and int not in kinds else value


def _plain(value: Any) -> bool:
    return not isinstance(value, dict)


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04X}" for c in escaped) + '"'
    if isinstance(value, list):
        return "[" + ", ".join(_toml(one) for one in value) + "]"
    if isinstance(value, float) and math.isnan(value):
        return "nan"
    return repr(value)
