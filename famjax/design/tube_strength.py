"""What the swage tubes of a catalogue bear while they are pushed through the die."""

import dataclasses
import math
from collections.abc import Iterable

from .. import units
from .buckling import tube_buckling, yield_load
from .catalogue import Catalogue, CatalogueError, CatalogueTube

ASSUMED: dict[str, tuple[float, str]] = {
    "modulus": (68.9e9, "68.9 GPa, of aluminium 6061-T6 (Aluminum Association, typical)"),
    "yield_stress": (276e6, "276 MPa, of aluminium 6061-T6 (Aluminum Association, typical)"),
    "supported_length": (1.85 * units.INCH, "1.85 in, left free by the reference work's support"),
    "free_length": (
        math.sqrt(2),
        "sqrt(2) times the supported one, as a support that doubles Euler's load implies",
    ),
}
"""What is taken, in SI, where neither the catalogue nor the user says: a value and what it is.

The free length is a multiple of the supported one: the reference work says that its support
"approximately doubles" the buckling load, and prints neither that length nor the tube's metal.
"""


@dataclasses.dataclass(frozen=True)
class TubeOptions:
    """What the user says of the swage tubes, before the catalogue; None: nothing.

    Attributes:
        modulus: Young's modulus [Pa].
        yield_stress: [Pa].
        free_length: [m], free to bend without a support.
        supported_length: [m], free to bend with it.
    """

    modulus: float | None = None
    yield_stress: float | None = None
    free_length: float | None = None
    supported_length: float | None = None


@dataclasses.dataclass(frozen=True)
class TubeStrength:
    """What a swage tube bears between pinned ends, unswaged.

    Attributes:
        tube: row of the catalogue.
        modulus: Young's modulus [Pa].
        yield_stress: [Pa].
        free_length: [m], without support.
        supported_length: [m], with it.
        unsupported_load: Euler's load [N] without support.
        supported_load: Euler's load [N] with it.
        yield_load: [N], at which the section yields.
        assumed: which of the first four numbers are from `ASSUMED`.
    """

    tube: CatalogueTube
    modulus: float
    yield_stress: float
    free_length: float
    supported_length: float
    unsupported_load: float
    supported_load: float
    yield_load: float
    assumed: tuple[str, ...]

    @property
    def gain(self) -> float:
        """Euler's load with the support over that without [-]."""
        return self.supported_load / self.unsupported_load

    @property
    def yields_first(self) -> bool:
        """Whether the bare tube is crushed before it buckles, so that a support gains nothing."""
        return self.yield_load < self.unsupported_load


def tube_strengths(catalogue: Catalogue, options: TubeOptions | None = None) -> list[TubeStrength]:
    """Buckling and yield load of every swage tube of the catalogue.

    A number is taken from the options, else from the catalogue, else from `ASSUMED`.

    Args:
        catalogue: from `load_catalogue`.
        options: in SI; None for none.

    Returns:
        One strength per tube, in the order of the catalogue.

    Raises:
        CatalogueError: the supported length exceeds the free one.
    """
    return [_strength(tube, options or TubeOptions()) for tube in catalogue.tubes]


def _strength(tube: CatalogueTube, options: TubeOptions) -> TubeStrength:
    known = {
        name: getattr(tube, name) if getattr(options, name) is None else getattr(options, name)
        for name in ASSUMED
    }
    assumed = tuple(name for name, value in known.items() if value is None)
    of = {name: ASSUMED[name][0] if name in assumed else known[name] for name in known}
    if "free_length" in assumed:
        of["free_length"] *= of["supported_length"]
    if of["supported_length"] > of["free_length"]:
        raise CatalogueError(
            f"{tube.name}: a support leaves less of the tube free, but its supported_length, "
            f"{of['supported_length']:.4g} m, exceeds the free_length, {of['free_length']:.4g} m"
        )
    found = tube_buckling(
        modulus=of["modulus"],
        outer_diameter=tube.outer_diameter,
        thickness=tube.thickness,
        length=of["free_length"],
        supported_length=of["supported_length"],
    )
    return TubeStrength(
        tube=tube,
        **of,
        unsupported_load=float(found.unsupported_load),
        supported_load=float(found.supported_load),
        yield_load=float(yield_load(of["yield_stress"], tube.outer_diameter, tube.thickness)),
        assumed=assumed,
    )


def assumption_notes(strengths: Iterable[TubeStrength]) -> list[str]:
    """A sentence for each number that was assumed for some tube: what it is, how to replace it."""
    assumed = {name for strength in strengths for name in strength.assumed}
    return [
        f"The {name.replace('_', ' ')} of swage tubes is assumed where the catalogue names none: "
        f"{what}. Write it into the catalogue, or give it as an option of the tube."
        for name, (_, what) in ASSUMED.items()
        if name in assumed
    ]
