"""TOML files as dataclasses: units in the keys, checked values, file and key in every message.

A dataclass says by its annotations what its fields may be, and a `Form` how they are spelt. What a
dataclass refuses when it is made is refused with the place in the file.
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
"""Makes the error of a message; a class of errors is one."""

_FINITE = sys.float_info.max
Positive = Annotated[float, Meta(gt=0, le=_FINITE, description="a number > 0 and finite")]
NotNegative = Annotated[float, Meta(ge=0, le=_FINITE, description="a number >= 0 and finite")]
Text = Annotated[str, Meta(pattern=r"\S", description="a text in quotes")]

_WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "a text in quotes"}
_COUNTS = {2: "two", 3: "three"}


@dataclasses.dataclass(frozen=True)
class Form:
    """Spelling of the fields of a dataclass, and of nested ones, in a file.

    Attributes:
        kinds: kind of unit of each field that is a quantity. Its key is the field's name and a unit,
            `stroke_in`: any of `UNITS[kind]` is read, the SI unit is written.
        keys: key of each other field whose key is not its name.
        codecs: of each class that is one value in the file: what writes it, what reads it.
    """

    kinds: Mapping[str, str] = dataclasses.field(default_factory=dict)
    keys: Mapping[str, str] = dataclasses.field(default_factory=dict)
    codecs: Mapping[type, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = dataclasses.field(
        default_factory=dict
    )

    def key(self, name: str) -> str:
        """The key under which a field is written."""
        if name in self.kinds:
            return _spelt(name, si_unit(self.kinds[name]))
        return self.keys.get(name, name)

    def keys_of(self, name: str) -> str:
        """All keys under which a quantity is read."""
        return ", ".join(_spelt(name, unit) for unit in UNITS[self.kinds[name]])

    def pattern(self, name: str) -> str:
        """The key of a field, with `<unit>` for any unit."""
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
        path: of the file or of a resource, UTF-8 with or without a byte order mark.
        what: it is, for messages: "plan".
        error: what is raised.
        where: what begins every message; the path unless given.

    Raises:
        InputError: the file cannot be read, or is no TOML file.
    """
    fault = f"{f'{path}: ' if where is None else where}cannot read the {what}"
    try:
        file = Path(path) if isinstance(path, str) else path
        return tomllib.loads(file.read_text(encoding="utf-8").removeprefix("\ufeff"))
    except OSError as problem:
        raise error(f"{fault}: {problem.strerror}") from None
    except UnicodeDecodeError:
        raise error(f"{fault}: it is not a UTF-8 text file; save it as TOML, UTF-8") from None
    except tomllib.TOMLDecodeError as problem:
        raise error(f"{fault}: it is not a TOML file: {problem}") from None


def from_entries(
    kind: type[T],
    entries: Mapping[str, Any],
    form: Form = PLAIN,
    *,
    where: str = "",
    error: Refusal = InputError,
) -> T:
    """Make a dataclass from the entries of a table, in SI.

    A single number stands for a list of one; "none" for None.

    Args:
        kind: the dataclass.
        entries: keys and values as TOML has them.
        form: how the fields are spelt.
        where: the place of the table, which begins every message: `"plan.toml: [rig]: "`.
        error: what is raised.

    Raises:
        InputError: a key that is unknown, missing, without a unit or there twice, a value of another
            type or out of range, or what the dataclass itself refuses.

    >>> @dataclasses.dataclass
    ... class Stroke:
    ...     stroke: Positive
    ...     cycles: int = 1
    >>> from_entries(Stroke, {"stroke_cm": 5}, Form({"stroke": "length"}))
    Stroke(stroke=0.05, cycles=1)
    """
    try:
        return kind(**_values(kind, entries, form))
    except ValueError as problem:  # of the dataclass, too
        raise error(f"{where}{problem}") from None


def check_fields(part: Any, error: Refusal = InputError) -> None:
    """Refuse a dataclass whose field violates its annotation, `Positive` for example.

    Args:
        part: the dataclass; to be called from its `__post_init__`.
        error: what is raised.

    Raises:
        InputError: a field has another type or is out of range.
    """
    for name, hint in typing.get_type_hints(type(part), include_extras=True).items():
        value = getattr(part, name)
        try:
            convert(None if value is None else _encoded(value, PLAIN), hint)
        except ValidationError:
            raise error(f"{name} must be {_described(hint)}, got {value!r}") from None


def to_entries(part: Any, form: Form = PLAIN) -> dict[str, Any]:
    """The entries of a dataclass in SI, of types that TOML and JSON know; see `from_entries`.

    A field is left out where it has its default and that says nothing: None, empty, not finite.
    """
    return {
        form.key(field.name): _encoded(value, form)
        for field in dataclasses.fields(part)
        for value in [getattr(part, field.name)]
        if not (_says_nothing(value) and value == field.default)
    }


def toml_text(entries: Mapping[str, Any]) -> str:
    """TOML text of entries and one level of tables; numbers keep every bit.

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
    """The fields of a dataclass by name."""
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
        raise InputError(f"{'; '.join(problems)}; known are {known}")
    return values


def _field(key: str, fields: Iterable[str], form: Form) -> tuple[str | None, float]:
    """Field of a key, None where there is no such field, and multiplier of its unit."""
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
    """A value as its field is annotated."""
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
    """What a value must be, in words."""
    kinds = typing.get_args(hint)
    if typing.get_origin(hint) is Annotated:
        words = [one.description for one in kinds if isinstance(one, Meta) and one.description]
        return words[0] if words else _described(kinds[0])
    if typing.get_origin(hint) is Literal:
        return " or ".join(map(str, kinds))
    if typing.get_origin(hint) is tuple:
        count = "" if Ellipsis in kinds else f"{_COUNTS.get(len(kinds), len(kinds))} "
        return f"{count}numbers in brackets"
    if NoneType in kinds:
        return _described(kinds[0])
    return _WORDS.get(hint, "a table")


def _scaled(value: Any, factor: float) -> Any:
    if factor == 1.0 or value is None:
        return value
    return tuple(one * factor for one in value) if isinstance(value, tuple) else value * factor


def _says_nothing(value: Any) -> bool:
    if isinstance(value, tuple):
        return not value or any(map(_says_nothing, value))
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
    return value.tolist() if hasattr(value, "tolist") else value  # of NumPy


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):  # JSON escapes all that TOML does but the last of the control codes
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(value).lower()  # true, nan, and the shortest digits that give the same number
