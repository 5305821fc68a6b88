"""Catalogues of braids, bladders and swage tubes: TOML files, the bundled one first."""

import dataclasses
import importlib.resources
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from msgspec import Meta

from .. import units
from ..boundary.errors import InputError
from ..boundary.toml_file import Form, Positive, Text, from_entries, read_toml

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

NOMINAL_ANGLE = math.pi / 4
"""Braid angle [rad] at which a braid has its nominal diameter: 45 deg."""

_ANGLE_AGREEMENT = (
    0.5 * units.DEGREE
)  # diameters are printed to 0.01 in: 0.15 deg on the small braid

_Size = Annotated[Positive, Meta(description="a number > 0 and finite or a list of them")]
_Pair = Annotated[
    tuple[Positive, Positive], Meta(description="two numbers in brackets, > 0 and finite")
]
_Coefficients = Annotated[
    tuple[float, ...],
    Meta(min_length=1, description="a list of numbers, the first that of the strain itself"),
]


class CatalogueError(InputError):
    """What is wrong with a catalogue file or an option, where, and what to write instead."""


def _check_wall(diameter: float, thickness: float) -> None:
    if not 2 * thickness < diameter:
        raise CatalogueError(
            f"a wall of {thickness:.4g} m closes a tube of {diameter:.4g} m; check the two units"
        )


@dataclasses.dataclass(frozen=True)
class CatalogueBraid:
    """A braided sleeve as it is sold.

    Attributes:
        name: unique in the catalogue.
        nominal_diameter: [m], that at 45 deg.
        thickness: t_braid [m], two threads crossing.
        diameter_range: smallest and largest diameter [m], where the braid jams.
        source: where the row comes from.
        boundary_range: the same, unless given, or wider [m]: what lies between the two is usable by
            its source, but outside its jamming range.
        angle_range: angles [rad] at the ends of `diameter_range` as printed, or None.
        n_threads: n [-], of both families, or None: the file does not say.
        breaking_load: of one thread [N], or None.
    """

    name: Text
    nominal_diameter: Positive
    thickness: Positive
    diameter_range: _Pair
    source: Text
    boundary_range: _Pair | None = None
    angle_range: _Pair | None = None
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
        if self.boundary_range is None:
            object.__setattr__(self, "boundary_range", self.diameter_range)
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
        if (self.n_threads is None) != (self.breaking_load is None):
            raise CatalogueError("n_threads must stand together with breaking_load")


@dataclasses.dataclass(frozen=True)
class CatalogueBladder:
    """A rubber tube as it is sold.

    Attributes:
        name: unique in the catalogue.
        diameter: outer [m].
        thickness: of the wall [m].
        source: where the row comes from.
        coefficients: E_n [Pa] of its rubber, as `PolynomialMaterial` takes them, or None: the file
            does not say.
        coefficients_source: where they come from, or None.
    """

    name: Text
    diameter: _Size
    thickness: _Size
    source: Text
    coefficients: _Coefficients | None = None
    coefficients_source: Text | None = None

    def __post_init__(self) -> None:
        _check_wall(self.diameter, self.thickness)

    @property
    def bore(self) -> float:
        """Inner diameter [m] at rest."""
        return self.diameter - 2 * self.thickness


@dataclasses.dataclass(frozen=True)
class CatalogueTube:
    """A swage tube as it is sold, and what the die does to it. None: the file does not say.

    Attributes:
        name: unique in the catalogue.
        outer_diameter: [m], before swaging.
        thickness: wall [m], before swaging.
        swage_reduction: of the outer diameter [m], in the die.
        source: where the row comes from.
        modulus: Young's modulus [Pa], or None.
        modulus_source: where the modulus comes from, or None.
        yield_stress: [Pa], or None.
        yield_stress_source: where the yield stress comes from, or None.
        free_length: [m], free to bend while it is pushed through the die, or None.
        supported_length: [m], what a support leaves free of it, or None.
    """

    name: Text
    outer_diameter: _Size
    thickness: _Size
    swage_reduction: Positive
    source: Text
    modulus: Positive | None = None
    modulus_source: Text | None = None
    yield_stress: Positive | None = None
    yield_stress_source: Text | None = None
    free_length: Positive | None = None
    supported_length: Positive | None = None

    def __post_init__(self) -> None:
        free, supported = self.free_length, self.supported_length
        if free is not None and supported is not None and supported > free:
            raise CatalogueError(
                f"supported_length, {supported:.4g} m, exceeds free_length, {free:.4g} m"
            )
        _check_wall(self.outer_diameter - self.swage_reduction, self.thickness)


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
    parts = []
    if bundled:
        resource = importlib.resources.files("famjax") / "data" / "catalogue.toml"
        parts.append(_read(resource, "bundled catalogue: "))
    parts += [_read(Path(path), f"{path}: ") for path in paths]
    rows = (_unique([row for part in parts for row in part[kind]], kind) for kind in _KINDS)
    return Catalogue(*map(tuple, rows))


_Rows = Annotated[
    tuple[dict[str, Any], ...], Meta(description="rows, with [[...]], two brackets, above each")
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


def _read(path: "Path | Traversable", where: str) -> dict[str, list[Any]]:
    """The rows of one file, by table."""
    content = read_toml(path, "catalogue", CatalogueError, where=where)
    file = from_entries(_CatalogueFile, content, where=where, error=CatalogueError)
    return {
        kind: [
            row
            for number, fields in enumerate(getattr(file, kind), 1)
            for row in _rows(kind, fields, f"{where}[[{kind}]] number {number}", file.source)
        ]
        for kind in _KINDS
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


_FORM = Form(
    kinds={
        **dict.fromkeys(("diameter", "nominal_diameter", "outer_diameter", "thickness"), "length"),
        **dict.fromkeys(("diameter_range", "boundary_range", "swage_reduction"), "length"),
        **dict.fromkeys(("free_length", "supported_length"), "length"),
        **dict.fromkeys(("modulus", "yield_stress", "coefficients"), "stress"),
        "breaking_load": "force",
        "angle_range": "angle",
    }
)


_KINDS: dict[str, tuple[type[Any], tuple[str, ...]]] = {
    "braid": (CatalogueBraid, ()),
    "bladder": (CatalogueBladder, ("diameter", "thickness")),
    "tube": (CatalogueTube, ("outer_diameter", "thickness")),
}
"""What a row of each table is, and which of its sizes may be lists."""


def _rows(kind: str, fields: Mapping[str, Any], where: str, source: str) -> list[Any]:
    """What one table of a file offers: a row for every pair of the sizes that it lists."""
    cls, sizes = _KINDS[kind]
    named = f" ({fields['name']!r})" if "name" in fields else ""
    rows = []
    for entries in _of_each_size(kind, fields, sizes) if sizes else [fields]:
        given = {"source": source, **entries}
        row = from_entries(cls, given, _FORM, where=f"{where}{named}: ", error=CatalogueError)
        for name in vars(row):
            figure = name.removesuffix("_source")
            if figure != name and (getattr(row, figure) is None) != (getattr(row, name) is None):
                raise CatalogueError(f"{where}{named}: {figure} must stand together with {name}")
        rows.append(row)
    return rows


def _of_each_size(
    kind: str, fields: Mapping[str, Any], sizes: Iterable[str]
) -> Iterator[dict[str, Any]]:
    """The entries of each row, named by its sizes as they stand in the file."""
    keys = [key for size in sizes for key in fields if key.startswith(f"{size}_")]
    lists = [one if isinstance(one := fields[key], list) and one else [one] for key in keys]
    for values in itertools.product(*lists):
        said = [
            f"{value:g} {key.rpartition('_')[2]}" if isinstance(value, int | float) else ""
            for key, value in zip(keys, values, strict=True)
        ]
        name = f"{kind} {' x '.join(said)}"
        yield {"name": name, **fields, **dict(zip(keys, values, strict=True))}
