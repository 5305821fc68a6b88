"""One row of a catalogue file: quantities are taken out of it, each with the unit in its key."""

import math
from collections.abc import Mapping
from typing import Any

from ..boundary.units import UNITS
from .catalogue import CatalogueError


class CatalogueRow:
    """The fields of a row; what is taken is gone, so that what is left is unknown.

    Attributes:
        where: file and row, for errors.
        source: where the file's numbers come from.
    """

    def __init__(self, fields: Mapping[str, Any], where: str, source: str):
        self._fields = dict(fields)
        self.where = where
        self.source = source

    def error(self, text: str) -> CatalogueError:
        """The error that says where."""
        return CatalogueError(f"{self.where}: {text}")

    def text(self, key: str) -> str | None:
        """A text, or None where it is not there."""
        value = self._fields.pop(key, None)
        if value is not None and (not isinstance(value, str) or not value.strip()):
            raise self.error(f"{key} must be a text in quotes, got {value!r}")
        return value

    def name(self, key: str = "name") -> str:
        """A required text."""
        value = self.text(key)
        if value is None:
            raise self.error(f'{key} is missing; write {key} = "..."')
        return value

    def written(self, name: str, kind: str = "length") -> tuple[list[float], str]:
        """The numbers of one quantity as written, with their unit; none where it is not there."""
        known = ", ".join(f"{name}_{unit}" for unit in UNITS[kind])
        if name in self._fields:
            raise self.error(f"{name} has no unit; write one of {known}")
        keys = [key for key in self._fields if key.rpartition("_")[0] == name]
        if not keys:
            return [], ""
        if len(keys) > 1:
            raise self.error(f"{name} is given twice, as {' and '.join(keys)}; keep one")
        unit = keys[0].rpartition("_")[2]
        if unit not in UNITS[kind]:
            raise self.error(f"{keys[0]} has the unknown unit {unit!r}; write one of {known}")
        value = self._fields.pop(keys[0])
        values = value if isinstance(value, list) else [value]
        for number in values or [None]:
            if isinstance(number, bool) or not isinstance(number, int | float):
                raise self.error(f"{keys[0]} must be a number or a list of them, got {value!r}")
            if not (math.isfinite(number) and number > 0):
                raise self.error(f"{keys[0]} must be > 0 and finite, got {number!r}")
        return [float(number) for number in values], unit

    def many(self, name: str) -> list[tuple[float, str]]:
        """(length [m], as written) of each value of a required length."""
        values, unit = self.written(name)
        if not values:
            raise self.error(f"{name} is missing; write for example {name}_in or {name}_mm")
        return [(value * UNITS["length"][unit], f"{value:g} {unit}") for value in values]

    def one(self, name: str) -> float:
        """A required length [m] that must be a single number."""
        values = self.many(name)
        if len(values) > 1:
            raise self.error(f"{name} must be one number, got {len(values)}")
        return values[0][0]

    def optional(self, name: str, kind: str = "length") -> float | None:
        """A single number in SI, or None where it is not there."""
        values, unit = self.written(name, kind)
        if len(values) > 1:
            raise self.error(f"{name} must be one number, got {len(values)}")
        return values[0] * UNITS[kind][unit] if values else None

    def sourced(self, name: str, kind: str) -> tuple[float | None, str | None]:
        """A number in SI that needs a source of its own, and that source; neither or both."""
        source = self.text(f"{name}_source")  # first: to `written` it is a quantity in "source"
        value = self.optional(name, kind)
        if (value is None) != (source is None):
            raise self.error(f"{name} must stand together with {name}_source")
        return value, source

    def pair(self, name: str, kind: str = "length") -> tuple[float, float] | None:
        """Two numbers in SI, or None where they are not there."""
        values, unit = self.written(name, kind)
        if values and len(values) != 2:
            raise self.error(f"{name} must be two numbers in brackets, got {values}")
        return (values[0] * UNITS[kind][unit], values[1] * UNITS[kind][unit]) if values else None

    def end(self, known: str) -> None:
        """Refuse what is left."""
        if self._fields:
            raise self.error(f"unknown key {min(self._fields)!r}; known are {known}")
