"""Reading catalogues: one or more TOML files, the bundled one first."""

import importlib.resources
import itertools
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from .. import units
from ..boundary.units import UNITS
from .catalogue import (
    NOMINAL_ANGLE,
    Catalogue,
    CatalogueBladder,
    CatalogueBraid,
    CatalogueError,
    CatalogueTest,
    CatalogueTube,
)


class CatalogueRow:
    """The fields of a row; each is removed when it is read, so that what remains is unknown.

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


_ANGLE_AGREEMENT = (
    0.5 * units.DEGREE
)  # diameters are printed to 0.01 in: 0.15 deg on the small braid


def load_catalogue(paths: Iterable[str | Path] = (), *, bundled: bool = True) -> Catalogue:
    """The catalogue that comes with famjax, followed by the user's own files.

    Args:
        paths: TOML files of the form of `famjax/data/catalogue.toml`.
        bundled: start from the bundled catalogue; if False, the files are all there is.

    Returns:
        The catalogue in SI.

    Raises:
        CatalogueError: what is wrong, with file and row: a missing or unknown unit, an unknown key,
            a value out of range, a name that is there twice, a test of what is not there.

    >>> catalogue = load_catalogue()
    >>> [braid.name for braid in catalogue.braids]
    ['Kevlar 1.5 in', 'Kevlar 2.0 in', 'Kevlar 2.5 in']
    >>> len(catalogue.bladders), len(catalogue.tubes)
    (15, 4)
    """
    texts = []
    if bundled:
        resource = importlib.resources.files("famjax") / "data" / "catalogue.toml"
        texts.append(("bundled catalogue", resource.read_text(encoding="utf-8")))
    texts.extend((str(path), _read(Path(path))) for path in paths)
    parts = [_parse(text, where) for where, text in texts]
    rows = {kind: _unique([row for part in parts for row in part[kind]], kind) for kind in _READERS}
    catalogue = Catalogue(*(tuple(rows[kind]) for kind in ("braid", "bladder", "tube", "test")))
    _check_tests(catalogue)
    return catalogue


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise CatalogueError(f"cannot read the catalogue {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise CatalogueError(f"{path} is not a UTF-8 text file; save it as TOML, UTF-8") from None


def _parse(text: str, where: str) -> dict[str, list[Any]]:
    """The rows of one file, by table."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CatalogueError(f"{where} is not a TOML file: {error}") from None
    source = document.pop("source", None)
    if not isinstance(source, str) or not source.strip():
        raise CatalogueError(
            f'{where} must say where its numbers come from: write source = "..." on its first line'
        )
    unknown = sorted(set(document) - set(_READERS))
    if unknown:
        known = ", ".join(f"[[{kind}]]" for kind in _READERS)
        raise CatalogueError(f"{where} has the unknown table {unknown[0]!r}; known are {known}")
    rows: dict[str, list[Any]] = {}
    for kind, reader in _READERS.items():
        table = document.get(kind, [])
        if not isinstance(table, list) or not all(isinstance(row, dict) for row in table):
            raise CatalogueError(f"{where}: write [[{kind}]], with two brackets, above each row")
        rows[kind] = []
        for number, fields in enumerate(table, 1):
            row = CatalogueRow(fields, f"{where}: [[{kind}]] number {number}", source)
            rows[kind].extend(reader(row))
    return rows


def _unique(rows: list[Any], kind: str) -> list[Any]:
    seen: dict[str, Any] = {}
    for row in rows:
        if row.name in seen:
            raise CatalogueError(
                f"the {kind} {row.name!r} is there twice: in {seen[row.name].source!r} and in "
                f"{row.source!r}; remove or rename one"
            )
        seen[row.name] = row
    return rows


def _check_tests(catalogue: Catalogue) -> None:
    """Refuse a test of a bladder or braid that no file offers."""
    offered = {"bladder": catalogue.bladders, "braid": catalogue.braids}
    for test in catalogue.tests:
        for kind, rows in offered.items():
            names = [row.name for row in rows]
            if getattr(test, kind) not in names:
                raise CatalogueError(
                    f"the test {test.name!r} is of the {kind} {getattr(test, kind)!r}, which is "
                    f"not offered; offered are {', '.join(names) or 'none'}"
                )


def _braids(row: CatalogueRow) -> list[CatalogueBraid]:
    name = row.name()
    row.where += f" ({name!r})"
    diameter_range = row.pair("diameter_range")
    if diameter_range is None:
        raise row.error("diameter_range is missing; write diameter_range_in = [smallest, largest]")
    braid = CatalogueBraid(
        name=name,
        nominal_diameter=row.one("nominal_diameter"),
        thickness=row.one("thickness"),
        diameter_range=diameter_range,
        boundary_range=row.pair("boundary_range") or diameter_range,
        angle_range=row.pair("angle_range", "angle"),
        source=row.source,
    )
    row.end("name, nominal_diameter, thickness, diameter_range, boundary_range, angle_range")
    _check_braid(braid, row)
    return [braid]


def _check_braid(braid: CatalogueBraid, row: CatalogueRow) -> None:
    nominal = braid.nominal_diameter
    smallest, largest = braid.diameter_range
    straight = nominal / math.cos(NOMINAL_ANGLE)
    if not smallest < nominal < largest < straight:
        raise row.error(
            "diameter_range must be [smallest, largest] with the nominal diameter between them and "
            f"less than nominal / cos(45 deg) = {straight:.4g} m, at which the threads lie all "
            f"round; got [{smallest:.4g}, {largest:.4g}] m about {nominal:.4g} m"
        )
    outer_smallest, outer_largest = braid.boundary_range
    if not outer_smallest <= smallest < largest <= outer_largest < straight:
        raise row.error(
            f"boundary_range must contain diameter_range and end below {straight:.4g} m; got "
            f"[{outer_smallest:.4g}, {outer_largest:.4g}] m about [{smallest:.4g}, {largest:.4g}] m"
        )
    for diameter, angle in zip(braid.diameter_range, braid.angle_range or (), strict=False):
        implied = math.acos(diameter / straight)
        if abs(implied - angle) > _ANGLE_AGREEMENT:
            raise row.error(
                f"angle_range gives {angle / units.DEGREE:.2f} deg at {diameter:.4g} m, where the "
                f"nominal diameter at 45 deg implies {implied / units.DEGREE:.2f} deg from the "
                "circumference; correct one of them (angles from the axis are 90 deg minus these)"
            )


def _bladders(row: CatalogueRow) -> list[CatalogueBladder]:
    sizes = list(itertools.product(row.many("diameter"), row.many("thickness")))
    row.end("diameter, thickness")
    for (diameter, _), (thickness, _) in sizes:
        _check_wall(diameter, thickness, row)
    return [
        CatalogueBladder(f"bladder {wide} x {thick}", diameter, thickness, row.source)
        for (diameter, wide), (thickness, thick) in sizes
    ]


def _tubes(row: CatalogueRow) -> list[CatalogueTube]:
    sizes = list(itertools.product(row.many("outer_diameter"), row.many("thickness")))
    reduction = row.one("swage_reduction")
    modulus, modulus_source = row.sourced("modulus", "stress")
    yield_stress, yield_stress_source = row.sourced("yield_stress", "stress")
    free, supported = row.optional("free_length"), row.optional("supported_length")
    row.end(
        "outer_diameter, thickness, swage_reduction, modulus, modulus_source, yield_stress, "
        "yield_stress_source, free_length, supported_length"
    )
    if free is not None and supported is not None and supported > free:
        raise row.error(f"supported_length, {supported:.4g} m, exceeds free_length, {free:.4g} m")
    for (diameter, _), (thickness, _) in sizes:
        _check_wall(diameter - reduction, thickness, row)
    return [
        CatalogueTube(
            name=f"tube {wide} x {thick}",
            outer_diameter=diameter,
            thickness=thickness,
            swage_reduction=reduction,
            modulus=modulus,
            modulus_source=modulus_source,
            yield_stress=yield_stress,
            yield_stress_source=yield_stress_source,
            free_length=free,
            supported_length=supported,
            source=row.source,
        )
        for (diameter, wide), (thickness, thick) in sizes
    ]


def _tests(row: CatalogueRow) -> list[CatalogueTest]:
    test = CatalogueTest(
        name=row.name(),
        bladder=row.name("bladder"),
        braid=row.name("braid"),
        burst_pressure=row.optional("burst_pressure", "pressure"),
        burst_force=row.optional("burst_force", "force"),
        tensile_force=row.optional("tensile_force", "force"),
        source=row.source,
    )
    row.end("name, bladder, braid, burst_pressure, burst_force, tensile_force")
    if test.burst_pressure is None and test.burst_force is None and test.tensile_force is None:
        raise row.error("a test needs burst_pressure, burst_force or tensile_force")
    return [test]


def _check_wall(diameter: float, thickness: float, row: CatalogueRow) -> None:
    if not 2 * thickness < diameter:
        raise row.error(
            f"a wall of {thickness:.4g} m closes a tube of {diameter:.4g} m; check the two units"
        )


_READERS: dict[str, Callable[[CatalogueRow], list[Any]]] = {
    "braid": _braids,
    "bladder": _bladders,
    "tube": _tubes,
    "test": _tests,
}
