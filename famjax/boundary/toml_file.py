"""Read and write TOML files as dataclasses, with units in the keys.

Annotations restrict the values of fields, and a `Form` defines their keys. Every error message states
the location in the file, including messages from errors that the dataclass itself raises.
"""

import dataclasses
import json
import math
import sys
import tomllib
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, TypeVar

from msgspec import Meta, ValidationError, convert

from .errors import InputError
from .units import UNITS

T = TypeVar("T")
Refusal = Callable[[str], InputError]
"""Function that creates an exception from a message, for example an exception class."""

_FINITE = sys.float_info.max
Positive = Annotated[float, Meta(gt=0, le=_FINITE, description="a number > 0 and finite")]
NotNegative = Annotated[float, Meta(ge=0, le=_FINITE, description="a number >= 0 and finite")]
Text = Annotated[str, Meta(pattern=r"\S", description="text in quotes")]

_WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "text in quotes"}


@dataclasses.dataclass(frozen=True)
class Form:
    """Rules for writing the fields of a dataclass, including nested dataclasses, to a file.

    Attributes:
        kinds: kind of unit for each field that is a quantity. The key is the field's name and a unit,
            such as `stroke_in`. Any unit in `UNITS[kind]` can be read; the SI unit is written.
        keys: keys of other fields whose key differs from the field's name.
    """

    kinds: Mapping[str, str] = dataclasses.field(default_factory=dict)
    keys: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def key(self, name: str) -> str:
        """Return the key under which a field is written."""
        return next(iter(self.known_keys(name)))

    def known_keys(self, name: str) -> dict[str, float]:
        """Return all keys under which a field is read, each with the multiplier that converts it to SI."""
        if name not in self.kinds:
            return {self.keys.get(name, name): 1.0}
        units = UNITS[self.kinds[name]]
        return {f"{name}_{unit}" if unit else name: size for unit, size in units.items()}

    def pattern(self, name: str) -> str:
        """Return the key of a field, with all possible units in angle brackets."""
        units = [unit for unit in UNITS[self.kinds[name]] if unit] if name in self.kinds else []
        return f"{name}_<{'|'.join(units)}>" if units else self.key(name)


PLAIN = Form()
"""Every key is the name of its field."""


def read_toml(
    path: Any, what: str, error: Refusal = InputError, *, where: str | None = None
) -> dict[str, Any]:
    """Read the entries in a TOML file.

    Args:
        path: path of the file or of a resource, UTF-8 with or without a byte order mark.
        what: type of the file in messages, such as "plan".
        error: exception to raise.
        where: prefix for every message; the path by default.

    Raises:
        InputError: the file cannot be read, or is not valid TOML.
    """
    fault = f"{f'{path}: ' if where is None else where}cannot read the {what}"
    try:
        file = Path(path) if isinstance(path, str) else path
        return tomllib.loads(file.read_text(encoding="utf-8").removeprefix("\ufeff"))
    except OSError as problem:
        raise error(f"{fault}: {problem.strerror}") from None
    except ValueError as problem:
        raise error(
            f"{fault}: it must be a TOML file in UTF-8, with decimal points and no repeated keys: {problem}"
        ) from None


def from_entries(
    kind: type[T], entries: Mapping[str, Any], form: Form = PLAIN,
    *, where: str = "", error: Refusal = InputError,
) -> T:  # fmt: skip
    """Build a dataclass in SI from the entries in a table.

    If a list is required, a single number is read as a list of one number. "none" is read as None.

    Args:
        kind: the dataclass.
        entries: keys and values from TOML.
        form: keys of the fields.
        where: location of the table and prefix for every message, such as `"plan.toml: [rig]: "`.
        error: exception to raise.

    Raises:
        InputError: a key is unknown, missing, repeated or lacks a unit; a value has the wrong type or
            is out of range; or the dataclass itself raises an error.

    >>> @dataclasses.dataclass
    ... class Stroke:
    ...     stroke: Positive
    ...     cycles: int = 1
    >>> from_entries(Stroke, {"stroke_cm": 5}, Form({"stroke": "length"}))
    Stroke(stroke=0.05, cycles=1)
    """
    try:
        return kind(**_values(kind, entries, form))
    except ValueError as problem:  # also raised by the dataclass
        raise error(f"{where}{problem}") from None


def check_fields(part: Any, error: Refusal = InputError) -> None:
    """Check every field of a dataclass against its annotation, for example `Positive`.

    Args:
        part: the dataclass; call this from its `__post_init__`.
        error: exception to raise.

    Raises:
        InputError: a field has the wrong type or is out of range.
    """
    for name, hint in typing.get_type_hints(type(part), include_extras=True).items():
        value = getattr(part, name)
        try:
            convert(None if value is None else _encoded(value, PLAIN), hint)
        except ValidationError:
            raise error(f"{name} must be {_described(hint)}, got {value!r}") from None


def to_entries(part: Any, form: Form = PLAIN) -> dict[str, Any]:
    """Return the entries for a dataclass in SI, as TOML and JSON types; see `from_entries`.

    A field with its default value is omitted if that default is None, empty or not finite.
    """
    return {
        form.key(field.name): _encoded(value, form)
        for field in dataclasses.fields(part)
        for value in [getattr(part, field.name)]
        if not (_is_empty(value) and value == field.default)
    }


def toml_text(entries: Mapping[str, Any]) -> str:
    """Return entries, with one level of tables, as TOML text; numbers are written exactly.

    >>> print(toml_text({"name": "a", "rig": {"limits": [0.1, 1]}}), end="")
    name = "a"
    <BLANKLINE>
    [rig]
    limits = [0.1, 1]
    """
    tables = {key: value for key, value in entries.items() if isinstance(value, dict)}
    lines = [f"{key} = {_toml(value)}" for key, value in entries.items() if key not in tables]
    for key, table in tables.items():
        lines += ["", f"[{key}]", *(f"{name} = {_toml(value)}" for name, value in table.items())]
    return "\n".join(lines) + "\n"


def _values(kind: Any, entries: Mapping[str, Any], form: Form) -> dict[str, Any]:
    """Return the fields of a dataclass by name."""
    hints = typing.get_type_hints(kind, include_extras=True)
    fields = {field.name: field for field in dataclasses.fields(kind)}
    known = {key: (name, size) for name in fields for key, size in form.known_keys(name).items()}
    found: dict[str, str] = {}
    values: dict[str, Any] = {}
    problems = [f"unknown key {key!r}" for key in entries if key not in known]
    for key in (key for key in entries if key in known):
        name, size = known[key]
        if name in found:
            raise InputError(f"{name} is set twice, as {found[name]} and {key}: remove one of them")
        found[name], values[name] = key, _scaled(_value(key, entries[key], hints[name], form), size)
    for name, field in fields.items():
        if name not in found and field.default is field.default_factory is dataclasses.MISSING:
            problems.append(f"{form.pattern(name)} is missing: {_described(hints[name])}")
    if problems:
        valid = ", ".join(map(form.pattern, fields))
        raise InputError(f"{'; '.join(problems)}; valid keys: {valid}")
    return values


def _value(key: str, value: Any, hint: Any, form: Form) -> Any:
    """Convert a value to the type of its field."""
    kinds = typing.get_args(hint)
    if value == "none" and NoneType in kinds and str not in kinds:
        return None
    if dataclasses.is_dataclass(hint) and isinstance(value, dict):
        return from_entries(typing.cast("Any", hint), value, form, where=f"[{key}]: ")
    listed = kinds[0] if typing.get_origin(hint) is Annotated else hint
    single = Ellipsis in typing.get_args(listed) and isinstance(value, int | float)
    try:
        return convert([value] if single else value, hint)
    except ValidationError:
        raise InputError(f"{key} must be {_described(hint)}, got {value!r}") from None


def _described(hint: Any) -> str:
    """Describe the allowed values in words."""
    kinds, origin = typing.get_args(hint), typing.get_origin(hint)
    if origin is Annotated:
        words = [one.description for one in kinds if isinstance(one, Meta) and one.description]
        return words[0] if words else _described(kinds[0])
    if origin is Literal:
        return " or ".join(map(str, kinds))
    if origin is tuple:
        count = "" if Ellipsis in kinds else f"{ {2: 'two', 3: 'three'}[len(kinds)] } "
        return f"{count}numbers in brackets"
    return _described(kinds[0]) if NoneType in kinds else _WORDS.get(hint, "a table")


def _scaled(value: Any, factor: float) -> Any:
    if factor == 1.0 or value is None:
        return value
    return tuple(one * factor for one in value) if isinstance(value, tuple) else value * factor


def _is_empty(value: Any) -> bool:
    if isinstance(value, tuple):
        return not value or any(map(_is_empty, value))
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def _encoded(value: Any, form: Form) -> Any:
    if value is None:
        return "none"
    if dataclasses.is_dataclass(value):
        return to_entries(value, form)
    if isinstance(value, tuple | list):
        return [_encoded(one, form) for one in value]
    return value.tolist() if hasattr(value, "tolist") else value  # NumPy


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):  # JSON escapes everything that TOML does, except \x7f
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(value).lower()  # true, nan, or the shortest digits that restore the number
