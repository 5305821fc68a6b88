"""Read and write TOML files as dataclasses, with units in the keys and the location in every message.

Annotations restrict the values of fields, and a `Form` defines their keys. Errors raised by the
dataclass itself are reported with the location in the file.
"""

import dataclasses
import json
import math
import sys
import tomllib
import typing
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from msgspec import Meta, ValidationError, convert

from .errors import InputError
from .units import UNITS, si_unit

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

T = TypeVar("T")
Refusal = Callable[[str], InputError]
"""Creates the exception for a message; an exception class works."""

_FINITE = sys.float_info.max
Positive = Annotated[float, Meta(gt=0, le=_FINITE, description="a number > 0 and finite")]
NotNegative = Annotated[float, Meta(ge=0, le=_FINITE, description="a number >= 0 and finite")]
Text = Annotated[str, Meta(pattern=r"\S", description="a text in quotes")]

_WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "a text in quotes"}


@dataclasses.dataclass(frozen=True)
class Form:
    """How the fields of a dataclass, and of nested ones, are written in a file.

    Attributes:
        kinds: kind of unit for each quantity. Its key is the field's name and a unit, such as
            `stroke_in`: every unit of `UNITS[kind]` is read, and the SI unit is written.
        keys: key of each other field, if it is not the field's name.
        codecs: for each class stored as a single value, functions that encode and decode it.
    """

    kinds: Mapping[str, str] = dataclasses.field(default_factory=dict)
    keys: Mapping[str, str] = dataclasses.field(default_factory=dict)
    codecs: Mapping[type, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = dataclasses.field(
        default_factory=dict
    )

    def key(self, name: str) -> str:
        """Return the key under which a field is written."""
        if name in self.kinds:
            return _spelt(name, si_unit(self.kinds[name]))
        return self.keys.get(name, name)

    def keys_of(self, name: str) -> str:
        """List all keys under which a quantity is read."""
        return ", ".join(_spelt(name, unit) for unit in UNITS[self.kinds[name]])

    def pattern(self, name: str) -> str:
        """Return the key of a field, with `<unit>` for any unit."""
        return f"{name}_<unit>" if name in self.kinds else self.key(name)


PLAIN = Form()
"""Every key is the name of its field."""


def read_toml(
    path: "str | Path | Traversable",
    what: str,
    error: Refusal = InputError,
    *,
    where: str | None = None,
) -> dict[str, Any]:
    """Read the entries of a TOML file.

    Args:
        path: path of the file or of a resource, UTF-8 with or without a byte order mark.
        what: type of the file for messages, such as "plan".
        error: exception to raise.
        where: prefix of every message; the path by default.

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
        raise error(f"{fault}: it is not a TOML file in UTF-8: {problem}") from None


def from_entries(
    kind: type[T],
    entries: Mapping[str, Any],
    form: Form = PLAIN,
    *,
    where: str = "",
    error: Refusal = InputError,
) -> T:
    """Build a dataclass from the entries of a table, in SI.

    A single number is read as a list with one element, and "none" as None.

    Args:
        kind: the dataclass.
        entries: keys and values from TOML.
        form: spelling of the fields.
        where: location of the table and prefix of every message, such as `"plan.toml: [rig]: "`.
        error: exception to raise.

    Raises:
        InputError: a key is unknown, missing, repeated or lacks a unit, a value has the wrong type or
            is out of range, or the dataclass itself raises an error.

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
    """Return the entries of a dataclass in SI, as TOML and JSON types; see `from_entries`.

    Omits fields with an uninformative default: None, empty or not finite.
    """
    return {
        form.key(field.name): _encoded(value, form)
        for field in dataclasses.fields(part)
        for value in [getattr(part, field.name)]
        if not (_is_empty(value) and value == field.default)
    }


def toml_text(entries: Mapping[str, Any]) -> str:
    """Return entries and one level of tables as TOML text; numbers keep every bit.

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


def _spelt(name: str, unit: str) -> str:
    return f"{name}_{unit}" if unit else name


def _values(kind: Any, entries: Mapping[str, Any], form: Form) -> dict[str, Any]:
    """Return the fields of a dataclass by name."""
    hints = typing.get_type_hints(kind, include_extras=True)
    fields = {field.name: field for field in dataclasses.fields(kind)}
    found: dict[str, str] = {}
    values: dict[str, Any] = {}
    problems = []
    for key, value in entries.items():
        name, factor = _field(key, fields, form)
        if name is None:
            problems.append(f"unknown key {key!r}")
        elif name in found:
            raise InputError(f"{name} is given twice, as {found[name]} and {key}; keep one")
        else:
            found[name] = key
            values[name] = _scaled(_value(key, value, hints[name], form), factor)
    for name, field in fields.items():
        if name not in found and field.default is field.default_factory is dataclasses.MISSING:
            units = f", as {form.keys_of(name)}" if name in form.kinds else ""
            problems.append(f"{form.pattern(name)} is missing: {_described(hints[name])}{units}")
    if problems:
        known = ", ".join(map(form.pattern, fields))
        raise InputError(f"{'; '.join(problems)}; valid keys: {known}")
    return values


def _field(key: str, fields: Iterable[str], form: Form) -> tuple[str | None, float]:
    """Return the field for a key (None if there is none) and the multiplier of its unit."""
    quantities = [name for name in fields if name in form.kinds]
    for name in fields:
        if name not in quantities and form.key(name) == key:
            return name, 1.0
    stems = [name for name in quantities if f"{key}_".startswith(f"{name}_")]
    if not stems:
        return None, 1.0
    name = max(stems, key=len)
    unit, kind = key[len(name) + 1 :], form.kinds[name]
    if unit in UNITS[kind]:
        return name, UNITS[kind][unit]
    fault = f"has the unknown unit {unit!r}" if unit else "has no unit"
    raise InputError(
        f"{key} {fault}: it must end with a unit of {kind}; write one of {form.keys_of(name)}"
    )


def _value(key: str, value: Any, hint: Any, form: Form) -> Any:
    """Convert a value to the type of its field."""
    kinds = typing.get_args(hint)
    coded = next((one for one in (hint, *kinds) if one in form.codecs), None)
    if coded is not None and not (value == "none" and NoneType in kinds):
        try:
            return form.codecs[coded][1](value)
        except (ValueError, TypeError) as problem:
            raise InputError(f"{key}: {problem}") from None
    if dataclasses.is_dataclass(hint):
        if not isinstance(value, dict):
            raise InputError(f"{key} must be a table, got {value!r}")
        return from_entries(typing.cast("Any", hint), value, form, where=f"[{key}]: ")
    if value == "none" and NoneType in kinds and str not in kinds:
        return None
    listed = kinds[0] if typing.get_origin(hint) is Annotated else hint
    single = Ellipsis in typing.get_args(listed) and isinstance(value, int | float)
    try:
        return convert([value] if single else value, hint)
    except ValidationError:
        raise InputError(f"{key} must be {_described(hint)}, got {value!r}") from None


def _described(hint: Any) -> str:
    """Describe the allowed values in words."""
    kinds = typing.get_args(hint)
    if typing.get_origin(hint) is Annotated:
        words = [one.description for one in kinds if isinstance(one, Meta) and one.description]
        return words[0] if words else _described(kinds[0])
    if typing.get_origin(hint) is Literal:
        return " or ".join(map(str, kinds))
    if typing.get_origin(hint) is tuple:
        count = "" if Ellipsis in kinds else f"{ {2: 'two', 3: 'three'}[len(kinds)] } "
        return f"{count}numbers in brackets"
    if NoneType in kinds:
        return _described(kinds[0])
    return _WORDS.get(hint, "a table")


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
    if type(value) in form.codecs:
        return form.codecs[type(value)][0](value)
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
