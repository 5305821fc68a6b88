"""The catalogue of braids, bladders and swage tubes that a muscle can be made from.

A catalogue is one or more TOML files; the bundled one, `famjax/data/catalogue.toml`, shows the
form. The unit of a quantity is the last part of its key, as in `thickness_in`; values are SI once
read.
"""

import dataclasses
import importlib.resources
import itertools
import math
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from . import units

UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": units.MILLIMETRE, "in": units.INCH},
    "angle": {"rad": 1.0, "deg": units.DEGREE},
    "modulus": {
        "Pa": 1.0,
        "kPa": units.KILOPASCAL,
        "MPa": units.MEGAPASCAL,
        "GPa": 1e9,
        "psi": units.PSI,
    },
}
"""Multipliers to SI of the units a catalogue knows, for each kind of quantity."""

NOMINAL_ANGLE = math.pi / 4
"""Braid angle [rad] at which a braid has its nominal diameter: 45 deg."""

_ANGLE_AGREEMENT = (
    0.5 * units.DEGREE
)  # diameters are printed to 0.01 in: 0.15 deg on the small braid


class CatalogueError(ValueError):
    """What is wrong with a catalogue file, in which row, and what to write instead."""


@dataclasses.dataclass(frozen=True)
class CatalogueBraid:
    """A braided sleeve as it is sold.

    Attributes:
        name: unique in the catalogue.
        nominal_diameter: [m], that at 45 deg.
        thickness: t_braid [m], two threads crossing.
        diameter_range: smallest and largest diameter [m], where the braid jams.
        boundary_range: the same or wider [m]: what lies between the two is usable by its source,
            but outside its jamming range.
        angle_range: angles [rad] at the ends of `diameter_range` as printed, or None.
        source: where the row comes from.
    """

    name: str
    nominal_diameter: float
    thickness: float
    diameter_range: tuple[float, float]
    boundary_range: tuple[float, float]
    angle_range: tuple[float, float] | None
    source: str


@dataclasses.dataclass(frozen=True)
class CatalogueBladder:
    """A rubber tube as it is sold: name, outer diameter [m], wall thickness [m], source."""

    name: str
    diameter: float
    thickness: float
    source: str

    @property
    def bore(self) -> float:
        """Inner diameter [m] at rest."""
        return self.diameter - 2 * self.thickness


@dataclasses.dataclass(frozen=True)
class CatalogueTube:
    """A swage tube as it is sold, and what the die does to it.

    Attributes:
        name: unique in the catalogue.
        outer_diameter: [m], before swaging.
        thickness: wall [m], before swaging.
        swage_reduction: of the outer diameter [m], in the die.
        modulus: Young's modulus [Pa], or None where the file gives none.
        modulus_source: where the modulus comes from, or None.
        source: where the row comes from.
    """

    name: str
    outer_diameter: float
    thickness: float
    swage_reduction: float
    modulus: float | None
    modulus_source: str | None
    source: str


@dataclasses.dataclass(frozen=True)
class Catalogue:
    """Everything offered, each in the order of the files."""

    braids: tuple[CatalogueBraid, ...]
    bladders: tuple[CatalogueBladder, ...]
    tubes: tuple[CatalogueTube, ...]


def load_catalogue(paths: Iterable[str | Path] = (), *, bundled: bool = True) -> Catalogue:
    """The catalogue that comes with famjax, followed by the user's own files.

    Args:
        paths: TOML files of the form of `famjax/data/catalogue.toml`.
        bundled: start from the bundled catalogue; if False, the files are all there is.

    Returns:
        The catalogue in SI.

    Raises:
        CatalogueError: what is wrong, with file and row: a missing or unknown unit, an unknown key,
            a value out of range, a name that is there twice.

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
    braids, bladders, tubes = (
        _unique([row for part in parts for row in part[kind]], kind) for kind in _READERS
    )
    return Catalogue(tuple(braids), tuple(bladders), tuple(tubes))


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
            row = _Row(fields, f"{where}: [[{kind}]] number {number}", source)
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


class _Row:
    """One row of a file; quantities are taken out of it until nothing is left."""

    def __init__(self, fields: Mapping[str, Any], where: str, source: str):
        self._fields = dict(fields)
        self.where = where
        self.source = source

    def error(self, text: str) -> CatalogueError:
        return CatalogueError(f"{self.where}: {text}")

    def text(self, key: str) -> str | None:
        value = self._fields.pop(key, None)
        if value is not None and (not isinstance(value, str) or not value.strip()):
            raise self.error(f"{key} must be a text in quotes, got {value!r}")
        return value

    def take(self, name: str, kind: str = "length") -> tuple[list[float], str]:
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
        values, unit = self.take(name)
        if not values:
            raise self.error(f"{name} is missing; write for example {name}_in or {name}_mm")
        return [(value * UNITS["length"][unit], f"{value:g} {unit}") for value in values]

    def one(self, name: str) -> float:
        """A required length [m] that must be a single number."""
        values = self.many(name)
        if len(values) > 1:
            raise self.error(f"{name} must be one number, got {len(values)}")
        return values[0][0]

    def pair(self, name: str, kind: str = "length") -> tuple[float, float] | None:
        """Two numbers in SI, or None where they are not there."""
        values, unit = self.take(name, kind)
        if values and len(values) != 2:
            raise self.error(f"{name} must be two numbers in brackets, got {values}")
        return (values[0] * UNITS[kind][unit], values[1] * UNITS[kind][unit]) if values else None

    def end(self, known: str) -> None:
        """Refuse what is left."""
        if self._fields:
            raise self.error(f"unknown key {min(self._fields)!r}; known are {known}")


def _braids(row: _Row) -> list[CatalogueBraid]:
    name = row.text("name")
    if name is None:
        raise row.error('name is missing; write name = "..."')
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


def _check_braid(braid: CatalogueBraid, row: _Row) -> None:
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


def _bladders(row: _Row) -> list[CatalogueBladder]:
    sizes = list(itertools.product(row.many("diameter"), row.many("thickness")))
    row.end("diameter, thickness")
    for (diameter, _), (thickness, _) in sizes:
        _check_wall(diameter, thickness, row)
    return [
        CatalogueBladder(f"bladder {wide} x {thick}", diameter, thickness, row.source)
        for (diameter, wide), (thickness, thick) in sizes
    ]


def _tubes(row: _Row) -> list[CatalogueTube]:
    sizes = list(itertools.product(row.many("outer_diameter"), row.many("thickness")))
    reduction = row.one("swage_reduction")
    modulus_source = row.text("modulus_source")  # first: to `take` it is a modulus in "source"
    moduli, unit = row.take("modulus", "modulus")
    row.end("outer_diameter, thickness, swage_reduction, modulus, modulus_source")
    if len(moduli) > 1 or bool(moduli) != (modulus_source is not None):
        raise row.error("modulus must be one number, and stand together with modulus_source")
    for (diameter, _), (thickness, _) in sizes:
        _check_wall(diameter - reduction, thickness, row)
    return [
        CatalogueTube(
            name=f"tube {wide} x {thick}",
            outer_diameter=diameter,
            thickness=thickness,
            swage_reduction=reduction,
            modulus=moduli[0] * UNITS["modulus"][unit] if moduli else None,
            modulus_source=modulus_source,
            source=row.source,
        )
        for (diameter, wide), (thickness, thick) in sizes
    ]


def _check_wall(diameter: float, thickness: float, row: _Row) -> None:
    if not 2 * thickness < diameter:
        raise row.error(
            f"a wall of {thickness:.4g} m closes a tube of {diameter:.4g} m; check the two units"
        )


_READERS = {"braid": _braids, "bladder": _bladders, "tube": _tubes}
