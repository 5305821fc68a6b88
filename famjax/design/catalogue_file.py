"""Reading catalogues: one or more TOML files, the bundled one first.

`famjax/data/catalogue.toml` shows the form. The unit of a quantity is the last part of its key, as
in `thickness_in`; values are SI once read.
"""

import importlib.resources
import itertools
import math
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from .. import units
from .catalogue import (
    NOMINAL_ANGLE,
    Catalogue,
    CatalogueBladder,
    CatalogueBraid,
    CatalogueError,
    CatalogueTest,
    CatalogueTube,
)
from .catalogue_row import CatalogueRow

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
