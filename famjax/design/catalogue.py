"""Catalogues of braids, bladders and swage tubes, and the swaged end-fittings that join them.

The fitting has two steps. On one lies the braid alone, on the other the bladder with the braid over
it. After the die the gap between fitting and tube, on each side, is what is left of the layers:

    on the braid:    d = D_bore - 2 t_braid (1 - c_braid)
    on the bladder:  d = D_bore - 2 t_braid - 2 t_bladder (1 - c_bladder)
    D_bore = D_tube - reduction - 2 t_tube

These are equations 2.6 and 2.7 of the reference work: the die leaves the wall of the tube as it is,
and over the far softer rubber the braid is not compressed. For the 7/8 in muscle they give 0.8387
in and 0.7475 in where 0.838 in and 0.748 in are published, within a thousandth of an inch. A wall
that keeps its section thickens by 0.0018 in, which on each side is 0.17 of the braid: measure the
bore of a swaged tube before trusting the sizes.

References:
    Chambers 2021, chapter 2, tables 2.4 and 2.5.
"""

import collections
import dataclasses
import importlib.resources
import itertools
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import jax.numpy as jnp
from msgspec import Meta

from .._arrays import Real, RealArray, as_real
from ..boundary.errors import InputError
from ..boundary.toml_file import Form, Positive, Text, from_entries, read_toml

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

NOMINAL_ANGLE = math.pi / 4
"""Braid angle [rad] at which a braid has its nominal diameter: 45 deg."""

_Size = Annotated[Positive, Meta(description="a number > 0 and finite or a list of them")]
_Pair = Annotated[
    tuple[Positive, Positive], Meta(description="two numbers in brackets, > 0 and finite")
]
_Coefficients = Annotated[
    tuple[float, ...],
    Meta(min_length=1, description="a list of numbers, the first that of the strain itself"),
]


class CatalogueError(InputError):
    """An error in a catalogue file or an option: what is wrong, where, and what to write instead."""


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
        outer_smallest, outer_largest = self.boundary_range or self.diameter_range
        if not outer_smallest <= smallest < largest <= outer_largest < straight:
            raise CatalogueError(
                f"boundary_range must contain diameter_range and end below {straight:.4g} m; got "
                f"[{outer_smallest:.4g}, {outer_largest:.4g}] m about [{smallest:.4g}, "
                f"{largest:.4g}] m"
            )


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
    """A swage tube as it is sold, and its reduction by the die.

    Attributes:
        name: unique in the catalogue.
        outer_diameter: [m], before swaging.
        thickness: wall [m], before swaging.
        swage_reduction: of the outer diameter [m], in the die.
        source: where the row comes from.
    """

    name: Text
    outer_diameter: _Size
    thickness: _Size
    swage_reduction: Positive
    source: Text

    def __post_init__(self) -> None:
        _check_wall(self.outer_diameter - self.swage_reduction, self.thickness)


@dataclasses.dataclass(frozen=True)
class Catalogue:
    """All parts on offer, in the order of the files."""

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
    rows = {kind: tuple(row for part in parts for row in part[kind]) for kind in _KINDS}
    for kind, of in rows.items():
        for name, count in collections.Counter(row.name for row in of).items():
            if count > 1:
                raise CatalogueError(f"the {kind} {name!r} is there twice: remove or rename one")
    return Catalogue(*rows.values())


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


_FORM = Form(
    kinds={
        **dict.fromkeys(("diameter", "nominal_diameter", "outer_diameter", "thickness"), "length"),
        **dict.fromkeys(("diameter_range", "boundary_range", "swage_reduction"), "length"),
        "coefficients": "stress",
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
    where += f" ({fields['name']!r}): " if "name" in fields else ": "
    keys = [key for size in sizes for key in fields if key.startswith(f"{size}_")]
    lists = [one if isinstance(one := fields[key], list) and one else [one] for key in keys]
    rows = []
    for values in itertools.product(*lists):
        units = (key.rpartition("_")[2] for key in keys)
        said = [
            f"{one} {unit}".replace(".0 ", " ") for one, unit in zip(values, units, strict=True)
        ]
        named = {"name": f"{kind} {' x '.join(said)}"} if sizes else {}
        given = {"source": source, **named, **fields, **dict(zip(keys, values, strict=True))}
        rows.append(from_entries(cls, given, _FORM, where=where, error=CatalogueError))
    return rows


# --- end-fittings


def swaged_bore(outer_diameter: Real, thickness: Real, reduction: Real) -> RealArray:
    """Bore D_bore [m] of a tube after the die, D - reduction - 2 t, its wall taken as unchanged.

    Args:
        outer_diameter: D [m], before swaging.
        thickness: wall t [m]; that after the die for one that thickens.
        reduction: of the outer diameter [m], in the die.

    Returns:
        D_bore [m], broadcast shape.

    >>> print(f"{swaged_bore(1.0, 0.058, 0.027):.3f}")  # inches
    0.857
    """
    return as_real(outer_diameter) - reduction - 2 * thickness


def fitting_diameter_on_braid(
    bore: Real, braid_thickness: Real, braid_compression: Real
) -> RealArray:
    """Diameter d [m] of the fitting under the braid alone, D_bore - 2 t_braid (1 - c_braid).

    Args:
        bore: D_bore [m], of the tube after swaging.
        braid_thickness: t_braid [m], two threads crossing.
        braid_compression: c_braid [-], the share by which the braid is thinned, in [0, 1).

    Returns:
        d [m], broadcast shape.

    References:
        Chambers 2021, equation 2.6.

    >>> print(f"{fitting_diameter_on_braid(0.857, 0.011, 0.17):.4f}")  # inches; 0.838 published
    0.8387
    """
    return jnp.asarray(bore - 2 * braid_thickness * (1 - braid_compression))


def fitting_diameter_on_bladder(
    bore: Real, braid_thickness: Real, bladder_thickness: Real, bladder_compression: Real
) -> RealArray:
    """Diameter d [m] of the fitting under bladder and braid, the braid not compressed.

    d = D_bore - 2 t_braid - 2 t_bladder (1 - c_bladder)

    Args:
        bore: D_bore [m], of the tube after swaging.
        braid_thickness: t_braid [m].
        bladder_thickness: t_bladder [m], at rest.
        bladder_compression: c_bladder [-], the share by which the bladder is thinned, in [0, 1).

    Returns:
        d [m], broadcast shape.

    References:
        Chambers 2021, equation 2.7.

    >>> print(f"{fitting_diameter_on_bladder(0.857, 0.011, 0.0625, 0.30):.4f}")  # 0.748 published
    0.7475
    """
    return jnp.asarray(
        bore - 2 * braid_thickness - 2 * bladder_thickness * (1 - bladder_compression)
    )


@dataclasses.dataclass(frozen=True)
class EndFitting:
    """One sizing of the inner fitting.

    Attributes:
        tube: swage tube.
        bladder: rubber tube.
        braid: sleeve.
        diameter_on_braid: [m], of the step under the braid.
        diameter_on_bladder: [m], of the step under bladder and braid.
        bore_stretch: [-], by how much the fitting must stretch the bladder's bore to enter it;
            negative where it goes in with clearance.
        feasible: True where the fitting has a positive diameter and goes into the bore with no more
            stretch than was allowed.
    """

    tube: CatalogueTube
    bladder: CatalogueBladder
    braid: CatalogueBraid
    diameter_on_braid: float
    diameter_on_bladder: float
    bore_stretch: float
    feasible: bool


def size_end_fittings(
    catalogue: Catalogue,
    braid: CatalogueBraid,
    bladder_diameter: float,
    *,
    braid_compression: float = 0.17,
    bladder_compression: float = 0.30,
    allowed_bore_stretch: float = 0.0,
) -> list[EndFitting]:
    """The inner fitting for every tube and every bladder of one diameter in the catalogue.

    Args:
        catalogue: from `load_catalogue`.
        braid: sleeve.
        bladder_diameter: outer diameter [m] of the bladder.
        braid_compression: c_braid [-]; 0.17 for the reference work's first muscle, 0.27 for every
            later one.
        bladder_compression: c_bladder [-]; 0.30 in the reference work.
        allowed_bore_stretch: [-], by how much the fitting may stretch the bladder's bore.

    Returns:
        One sizing per tube and bladder thickness, in the order of the catalogue.

    Raises:
        ValueError: no bladder of that diameter, or a compression outside [0, 1).
    """
    for name, share in (("braid", braid_compression), ("bladder", bladder_compression)):
        if not 0 <= share < 1:
            raise ValueError(f"the compression of the {name} must be in [0, 1), got {share}")
    bladders = [b for b in catalogue.bladders if abs(b.diameter / bladder_diameter - 1) < 1e-9]
    if not bladders:
        offered = ", ".join(f"{d:.6g}" for d in sorted({b.diameter for b in catalogue.bladders}))
        raise ValueError(
            f"the catalogue has no bladder of diameter {bladder_diameter:.6g} m; it has {offered} m"
        )
    found = []
    for tube, bladder in itertools.product(catalogue.tubes, bladders):
        bore = swaged_bore(tube.outer_diameter, tube.thickness, tube.swage_reduction)
        on_braid = float(fitting_diameter_on_braid(bore, braid.thickness, braid_compression))
        on_bladder = float(
            fitting_diameter_on_bladder(
                bore, braid.thickness, bladder.thickness, bladder_compression
            )
        )
        stretch = on_bladder / bladder.bore - 1
        fits = on_bladder > 0 and stretch <= allowed_bore_stretch
        found.append(EndFitting(tube, bladder, braid, on_braid, on_bladder, stretch, fits))
    return found
