"""Reading catalogues: one or more TOML files, the bundled one first."""

import dataclasses
import importlib.resources
import itertools
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from msgspec import Meta

from ..boundary.toml_file import Form, from_entries, read_toml
from .catalogue import (
    Catalogue,
    CatalogueBladder,
    CatalogueBraid,
    CatalogueError,
    CatalogueTest,
    CatalogueTube,
)

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable


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
    rows = (_unique([row for part in parts for row in part[kind]], kind) for kind in _KINDS)
    catalogue = Catalogue(*map(tuple, rows))
    _check_tests(catalogue)
    return catalogue


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
    test: _Rows = ()


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


_KINDS: dict[str, tuple[type[Any], tuple[str, ...]]] = {
    "braid": (CatalogueBraid, ()),
    "bladder": (CatalogueBladder, ("diameter", "thickness")),
    "tube": (CatalogueTube, ("outer_diameter", "thickness")),
    "test": (CatalogueTest, ()),
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
