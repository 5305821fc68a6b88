"""Catalogues of braids, bladders and swage tubes, and the swaged end-fittings that join them.

The fitting has two steps: one step carries only the braid, the other the bladder with the braid over
it. After swaging, the gap between the fitting and the tube on each side equals the thickness of the
compressed layers:

    on the braid:    d = D_bore - 2 t_braid (1 - c_braid)
    on the bladder:  d = D_bore - 2 t_braid - 2 t_bladder (1 - c_bladder)
    D_bore = D_tube - reduction - 2 t_tube

These are equations 2.6 and 2.7 in the reference work. They assume that the die does not change the wall
thickness of the tube, and that the braid is not compressed where it lies over the far softer rubber. For
the 7/8 in muscle, the results are 0.8387 in and 0.7475 in; the published values are 0.838 in and 0.748 in.
If the wall keeps its cross-sectional area, it thickens by 0.0018 in on each side, which is 0.17 of the
braid's thickness. Measure the bore of a swaged tube before you rely on these sizes.

References:
    Chambers 2021, chapter 2, tables 2.4 and 2.5.
"""

import collections
import dataclasses
import importlib.resources
import math
from collections.abc import Iterable
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

_ROUNDING = 1e-9  # relative: 0.75 in and 19.05 mm are the same diameter

_Pair = Annotated[
    tuple[Positive, Positive], Meta(description="two numbers in brackets, > 0 and finite")
]
_Coefficients = Annotated[
    tuple[float, ...],
    Meta(min_length=1, description="a list of numbers, beginning with the linear coefficient"),
]


def _check_wall(diameter: float, thickness: float) -> None:
    if not 2 * thickness < diameter:
        raise InputError(
            f"twice the wall thickness must be less than the diameter, got {thickness:.4g} m and "
            f"{diameter:.4g} m; check both units"
        )


@dataclasses.dataclass(frozen=True)
class CatalogueBraid:
    """A commercial braided sleeve.

    Attributes:
        name: name, unique in the catalogue.
        nominal_diameter: diameter [m] at a braid angle of 45 deg.
        thickness: t_braid [m] where two threads cross.
        diameter_range: smallest and largest diameters [m], at which the braid jams.
        boundary_range: wider range of usable diameters [m], if the source states one, or None.
        n_threads: number n [-] of threads in both directions, or None if unknown.
        breaking_load: breaking load [N] of one thread, or None if unknown.
    """

    name: Text
    nominal_diameter: Positive
    thickness: Positive
    diameter_range: _Pair
    boundary_range: _Pair | None = None
    n_threads: Positive | None = None
    breaking_load: Positive | None = None

    def __post_init__(self) -> None:
        nominal = self.nominal_diameter
        straight = nominal / math.cos(NOMINAL_ANGLE)
        smallest, largest = self.diameter_range
        if not smallest < nominal < largest < straight:
            raise InputError(
                "diameter_range must be [smallest, largest], must contain the nominal diameter and must "
                f"end below nominal / cos(45 deg) = {straight:.4g} m, where the threads run around the "
                f"muscle; got [{smallest:.4g}, {largest:.4g}] m and a nominal diameter of {nominal:.4g} m"
            )

    def fits(self, diameter: float) -> bool:
        """Return True if the braid can be used on a bladder with this outer diameter [m]."""
        smallest, largest = self.boundary_range or self.diameter_range
        return smallest * (1 - _ROUNDING) <= diameter <= largest * (1 + _ROUNDING)


@dataclasses.dataclass(frozen=True)
class CatalogueBladder:
    """A commercial rubber tube.

    Attributes:
        name: name, unique in the catalogue.
        diameter: outer diameter [m].
        thickness: wall thickness [m].
        coefficients: E_n [Pa] of the rubber for `PolynomialMaterial`, or None if unknown.
    """

    name: Text
    diameter: Positive
    thickness: Positive
    coefficients: _Coefficients | None = None

    def __post_init__(self) -> None:
        _check_wall(self.diameter, self.thickness)

    @property
    def bore(self) -> float:
        """Inner diameter [m] at rest."""
        return self.diameter - 2 * self.thickness


@dataclasses.dataclass(frozen=True)
class CatalogueTube:
    """A commercial swage tube, and its reduction in the die.

    Attributes:
        name: name, unique in the catalogue.
        outer_diameter: outer diameter [m] before swaging.
        thickness: wall thickness [m] before swaging.
        swage_reduction: reduction of the outer diameter [m] in the die.
    """

    name: Text
    outer_diameter: Positive
    thickness: Positive
    swage_reduction: Positive

    def __post_init__(self) -> None:
        _check_wall(self.outer_diameter - self.swage_reduction, self.thickness)


@dataclasses.dataclass(frozen=True)
class Catalogue:
    """All available parts, in the order of the files."""

    braids: tuple[CatalogueBraid, ...]
    bladders: tuple[CatalogueBladder, ...]
    tubes: tuple[CatalogueTube, ...]


def load_catalogue(paths: Iterable[str | Path] = (), *, bundled: bool = True) -> Catalogue:
    """Load the bundled catalogue, followed by the user's own files.

    Args:
        paths: TOML files in the format of `famjax/data/catalogue.toml`.
        bundled: if False, the bundled catalogue is omitted.

    Returns:
        The catalogue in SI units.

    Raises:
        InputError: a unit is missing or unknown, a key is unknown, a value is out of range, or a name is
            used twice; the message states the file and the row.

    >>> catalogue = load_catalogue()
    >>> [braid.name for braid in catalogue.braids]
    ['Kevlar 1.5 in', 'Kevlar 2.0 in', 'Kevlar 2.5 in']
    >>> len(catalogue.bladders), len(catalogue.tubes)
    (15, 4)
    """
    own = importlib.resources.files("famjax") / "data" / "catalogue.toml"
    parts = [_read(own, "bundled catalogue: ")] if bundled else []
    parts += [_read(Path(path), f"{path}: ") for path in paths]
    rows = {kind: tuple(row for part in parts for row in part[kind]) for kind in _KINDS}
    for kind, of in rows.items():
        for name, count in collections.Counter(row.name for row in of).items():
            if count > 1:
                raise InputError(f"the {kind} {name!r} appears twice: remove or rename one of them")
    return Catalogue(*rows.values())


_Rows = Annotated[tuple[dict[str, Any], ...], Meta(description="rows, each below a [[...]] line")]


@dataclasses.dataclass(frozen=True)
class _CatalogueFile:
    source: str = ""  # of the numbers, for the reader
    braid: _Rows = ()
    bladder: _Rows = ()
    tube: _Rows = ()


_KINDS: dict[str, type[Any]] = {
    "braid": CatalogueBraid, "bladder": CatalogueBladder, "tube": CatalogueTube,
}  # fmt: skip
_FORM = Form(
    kinds={
        **dict.fromkeys(("diameter", "nominal_diameter", "outer_diameter", "thickness"), "length"),
        **dict.fromkeys(("diameter_range", "boundary_range", "swage_reduction"), "length"),
        "coefficients": "stress",
        "breaking_load": "force",
    }
)


def _read(path: "Path | Traversable", where: str) -> dict[str, list[Any]]:
    content = read_toml(path, "catalogue", where=where)
    file = from_entries(_CatalogueFile, content, where=where)
    found: dict[str, list[Any]] = {}
    for kind, cls in _KINDS.items():
        found[kind] = []
        for k, fields in enumerate(getattr(file, kind), 1):
            name = f" ({fields['name']!r})" if "name" in fields else ""
            at = f"{where}[[{kind}]] number {k}{name}: "
            found[kind].append(from_entries(cls, fields, _FORM, where=at))
    return found


# --- end-fittings


def swaged_bore(outer_diameter: Real, thickness: Real, reduction: Real) -> RealArray:
    """Return the bore D_bore [m] of a swaged tube, D - reduction - 2 t, for an unchanged wall thickness.

    Args:
        outer_diameter: D [m] before swaging.
        thickness: wall thickness t [m]; if the wall thickens in the die, the value after swaging.
        reduction: reduction of the outer diameter [m] in the die.

    Returns:
        D_bore [m], broadcast shape.

    >>> print(f"{swaged_bore(1.0, 0.058, 0.027):.3f}")  # inches
    0.857
    """
    return as_real(outer_diameter) - reduction - 2 * thickness


def fitting_diameter_on_braid(
    bore: Real, braid_thickness: Real, braid_compression: Real
) -> RealArray:
    """Return the fitting diameter d [m] under only the braid, D_bore - 2 t_braid (1 - c_braid).

    Args:
        bore: D_bore [m] of the tube after swaging.
        braid_thickness: t_braid [m] where two threads cross.
        braid_compression: c_braid [-], relative reduction in the thickness of the braid, in [0, 1).

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
    """Return the fitting diameter d [m] under the bladder and braid; the braid is not compressed.

    d = D_bore - 2 t_braid - 2 t_bladder (1 - c_bladder)

    Args:
        bore: D_bore [m] of the tube after swaging.
        braid_thickness: t_braid [m].
        bladder_thickness: t_bladder [m] at rest.
        bladder_compression: c_bladder [-], relative reduction in the thickness of the bladder, in [0, 1).

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


BRAID_COMPRESSION, BLADDER_COMPRESSION = 0.17, 0.30
"""Compressions c [-] in the first muscle of the reference work; later muscles use 0.27 for the braid."""


@dataclasses.dataclass(frozen=True)
class EndFitting:
    """Dimensions of the inner part of an end-fitting.

    Attributes:
        tube: swage tube.
        bladder: rubber tube.
        braid: braided sleeve.
        diameter_on_braid: diameter [m] of the step under only the braid.
        diameter_on_bladder: diameter [m] of the step under the bladder and the braid.
        bore_stretch: relative stretch [-] of the bladder's bore over the fitting; negative if there
            is clearance.
        feasible: True if the diameter is positive and the bore is not stretched.
    """

    tube: CatalogueTube
    bladder: CatalogueBladder
    braid: CatalogueBraid
    diameter_on_braid: float
    diameter_on_bladder: float
    bore_stretch: float
    feasible: bool


def size_end_fittings(
    catalogue: Catalogue, braid: CatalogueBraid, bladder: CatalogueBladder
) -> list[EndFitting]:
    """Calculate the inner fitting for a braid and a bladder with each swage tube in a catalogue.

    Returns:
        One fitting for each tube, in the order of the catalogue.
    """
    found = []
    for tube in catalogue.tubes:
        bore = swaged_bore(tube.outer_diameter, tube.thickness, tube.swage_reduction)
        on_braid = float(fitting_diameter_on_braid(bore, braid.thickness, BRAID_COMPRESSION))
        layers = bore, braid.thickness, bladder.thickness
        on_bladder = float(fitting_diameter_on_bladder(*layers, BLADDER_COMPRESSION))
        stretch = on_bladder / bladder.bore - 1
        fits = on_bladder > 0 and stretch <= 0
        found.append(EndFitting(tube, bladder, braid, on_braid, on_bladder, stretch, fits))
    return found
