"""Reading catalogues: one or more TOML files, the bundled one first."""

import dataclasses
import importlib.resources
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from msgspec import Meta

from .. import units
from ..boundary.toml_file import Form, Positive, Text, from_entries, read_toml
from .catalogue import (
    NOMINAL_ANGLE,
    Catalogue,
    CatalogueBladder,
    CatalogueBraid,
    CatalogueError,
    CatalogueTest,
    CatalogueTube,
)

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

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
    parts = []
    if bundled:
        resource = importlib.resources.files("famjax") / "data" / "catalogue.toml"
        parts.append(_read(resource, "bundled catalogue: "))
    parts += [_read(Path(path), f"{path}: ") for path in paths]
    rows = {kind: _unique([row for part in parts for row in part[kind]], kind) for kind in _READERS}
    catalogue = Catalogue(*(tuple(rows[kind]) for kind in ("braid", "bladder", "tube", "test")))
    _check_tests(catalogue)
    return catalogue


_Rows = Annotated[
    tuple[dict[str, Any], ...], Meta(description="rows, with [[...]], two brackets, above each")
]
_Sizes = Annotated[
    tuple[Positive, ...],
    Meta(min_length=1, description="a number > 0 and finite or a list of them"),
]
_Coefficients = Annotated[
    tuple[float, ...],
    Meta(min_length=1, description="a list of numbers, the first that of the strain itself"),
]
_Pair = Annotated[
    tuple[Positive, Positive], Meta(description="two numbers in brackets, > 0 and finite")
]


@dataclasses.dataclass(frozen=True)
class _CatalogueFile:
    source: Annotated[
        str,
        Meta(pattern=r"\S", description="a text in quotes that says where its numbers come from"),
    ]
    braid: _Rows = ()
    bladder: _Rows = ()
    tube: _Rows = ()
    test: _Rows = ()


def _read(path: "Path | Traversable", where: str) -> dict[str, list[Any]]:
    """The rows of one file, by table."""
    content = read_toml(path, "catalogue", CatalogueError, where=where)
    file = from_entries(_CatalogueFile, content, where=where, error=CatalogueError)
    return {
        kind: [
            row
            for number, fields in enumerate(getattr(file, kind), 1)
            for row in reader(fields, f"{where}[[{kind}]] number {number}", file.source)
        ]
        for kind, reader in _READERS.items()
    }


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


@dataclasses.dataclass(frozen=True)
class _BraidRow:
    name: Text
    nominal_diameter: Positive
    thickness: Positive
    diameter_range: _Pair
    boundary_range: _Pair | None = None
    angle_range: _Pair | None = None
    made_to_order_range: _Pair | None = None
    n_threads: Positive | None = None
    breaking_load: Positive | None = None

    def __post_init__(self) -> None:
        nominal = self.nominal_diameter
        smallest, largest = self.diameter_range
        straight = nominal / math.cos(NOMINAL_ANGLE)
        if not smallest < nominal < largest < straight:
            raise CatalogueError(
                "diameter_range must be [smallest, largest] with the nominal diameter between them "
                f"and less than nominal / cos(45 deg) = {straight:.4g} m, at which the threads lie "
                f"all round; got [{smallest:.4g}, {largest:.4g}] m about {nominal:.4g} m"
            )
        outer_smallest, outer_largest = self.boundary_range or self.diameter_range
        if not outer_smallest <= smallest < largest <= outer_largest < straight:
            raise CatalogueError(
                f"boundary_range must contain diameter_range and end below {straight:.4g} m; got "
                f"[{outer_smallest:.4g}, {outer_largest:.4g}] m about [{smallest:.4g}, "
                f"{largest:.4g}] m"
            )
        for diameter, angle in zip(self.diameter_range, self.angle_range or (), strict=False):
            implied = math.acos(diameter / straight)
            if abs(implied - angle) > _ANGLE_AGREEMENT:
                raise CatalogueError(
                    f"angle_range gives {angle / units.DEGREE:.2f} deg at {diameter:.4g} m, where "
                    f"the nominal diameter at 45 deg implies {implied / units.DEGREE:.2f} deg from "
                    "the circumference; correct one of them (angles from the axis are 90 deg minus "
                    "these)"
                )
        woven = self.made_to_order_range
        if woven is not None and not woven[0] <= nominal <= woven[1]:
            raise CatalogueError(
                "made_to_order_range must be [least, greatest] nominal diameter, with that of the row "
                f"between them; got [{woven[0]:.4g}, {woven[1]:.4g}] m about {nominal:.4g} m"
            )
        if (self.n_threads is None) != (self.breaking_load is None):
            raise CatalogueError("n_threads must stand together with breaking_load")


@dataclasses.dataclass(frozen=True)
class _BladderRow:
    diameter: _Sizes
    thickness: _Sizes
    coefficients: _Coefficients | None = None
    coefficients_source: Text | None = None

    def __post_init__(self) -> None:
        if (self.coefficients is None) != (self.coefficients_source is None):
            raise CatalogueError("coefficients must stand together with coefficients_source")
        _check_walls(self.diameter, self.thickness)


@dataclasses.dataclass(frozen=True)
class _TubeRow:
    outer_diameter: _Sizes
    thickness: _Sizes
    swage_reduction: Positive
    modulus: Positive | None = None
    modulus_source: Text | None = None
    yield_stress: Positive | None = None
    yield_stress_source: Text | None = None
    free_length: Positive | None = None
    supported_length: Positive | None = None

    def __post_init__(self) -> None:
        for name in ("modulus", "yield_stress"):
            if (getattr(self, name) is None) != (getattr(self, f"{name}_source") is None):
                raise CatalogueError(f"{name} must stand together with {name}_source")
        free, supported = self.free_length, self.supported_length
        if free is not None and supported is not None and supported > free:
            raise CatalogueError(
                f"supported_length, {supported:.4g} m, exceeds free_length, {free:.4g} m"
            )
        _check_walls([d - self.swage_reduction for d in self.outer_diameter], self.thickness)


@dataclasses.dataclass(frozen=True)
class _TestRow:
    name: Text
    bladder: Text
    braid: Text
    burst_pressure: Positive | None = None
    burst_force: Positive | None = None
    tensile_force: Positive | None = None

    def __post_init__(self) -> None:
        if self.burst_pressure is None and self.burst_force is None and self.tensile_force is None:
            raise CatalogueError("a test needs burst_pressure, burst_force or tensile_force")


def _check_walls(diameters: Iterable[float], thicknesses: Iterable[float]) -> None:
    for diameter, thickness in itertools.product(diameters, thicknesses):
        if not 2 * thickness < diameter:
            raise CatalogueError(
                f"a wall of {thickness:.4g} m closes a tube of {diameter:.4g} m; check the two "
                "units"
            )


_Row = TypeVar("_Row")
_FORM = Form(
    kinds={
        **dict.fromkeys(("diameter", "nominal_diameter", "outer_diameter", "thickness"), "length"),
        **dict.fromkeys(("diameter_range", "boundary_range", "swage_reduction"), "length"),
        "made_to_order_range": "length",
        **dict.fromkeys(("free_length", "supported_length"), "length"),
        **dict.fromkeys(("modulus", "yield_stress", "coefficients"), "stress"),
        **dict.fromkeys(("burst_force", "tensile_force", "breaking_load"), "force"),
        "angle_range": "angle",
        "burst_pressure": "pressure",
    }
)


def _row(kind: type[_Row], fields: Mapping[str, Any], where: str) -> _Row:
    return from_entries(kind, fields, _FORM, where=where, error=CatalogueError)


def _braids(fields: Mapping[str, Any], where: str, source: str) -> list[CatalogueBraid]:
    row = _row(_BraidRow, fields, f"{where} ({fields.get('name')!r}): ")
    values: dict[str, Any] = vars(row) | {
        "boundary_range": row.boundary_range or row.diameter_range
    }
    return [CatalogueBraid(**values, source=source)]


def _bladders(fields: Mapping[str, Any], where: str, source: str) -> list[CatalogueBladder]:
    row = _row(_BladderRow, fields, f"{where}: ")
    names = itertools.product(_written("diameter", fields), _written("thickness", fields))
    sizes = itertools.product(row.diameter, row.thickness)
    return [
        CatalogueBladder(
            f"bladder {wide} x {thick}",
            diameter,
            thickness,
            source,
            row.coefficients,
            row.coefficients_source,
        )
        for (wide, thick), (diameter, thickness) in zip(names, sizes, strict=True)
    ]


def _tubes(fields: Mapping[str, Any], where: str, source: str) -> list[CatalogueTube]:
    row = _row(_TubeRow, fields, f"{where}: ")
    sizes_apart = {"outer_diameter", "thickness"}
    values: dict[str, Any] = {k: v for k, v in vars(row).items() if k not in sizes_apart}
    names = itertools.product(_written("outer_diameter", fields), _written("thickness", fields))
    sizes = itertools.product(row.outer_diameter, row.thickness)
    return [
        CatalogueTube(
            **values,
            outer_diameter=diameter,
            thickness=thickness,
            name=f"tube {wide} x {thick}",
            source=source,
        )
        for (wide, thick), (diameter, thickness) in zip(names, sizes, strict=True)
    ]


def _tests(fields: Mapping[str, Any], where: str, source: str) -> list[CatalogueTest]:
    return [CatalogueTest(**vars(_row(_TestRow, fields, f"{where}: ")), source=source)]


def _written(name: str, fields: Mapping[str, Any]) -> list[str]:
    """The sizes of a row with their unit, as they stand in the file."""
    for key, value in fields.items():
        if key.startswith(f"{name}_"):
            unit = key.removeprefix(f"{name}_")
            return [f"{size:g} {unit}" for size in (value if isinstance(value, list) else [value])]
    return []


_READERS: dict[str, Callable[[Mapping[str, Any], str, str], list[Any]]] = {
    "braid": _braids,
    "bladder": _bladders,
    "tube": _tubes,
    "test": _tests,
}
