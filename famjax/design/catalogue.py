"""What a catalogue offers: braids, bladders, swage tubes, and the tests of muscles made of them."""

import dataclasses
import math
from typing import Annotated

from msgspec import Meta

from .. import units
from ..boundary.errors import InputError
from ..boundary.toml_file import Positive, Text

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
        made_to_order_range: least and greatest nominal diameter [m] to which it is woven on order, or
            None where it is sold as it is. The angles at which it jams stay those of the row.
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
        woven = self.made_to_order_range
        if woven is not None and not woven[0] <= nominal <= woven[1]:
            raise CatalogueError(
                "made_to_order_range must be [least, greatest] nominal diameter, with that of the row "
                f"between them; got [{woven[0]:.4g}, {woven[1]:.4g}] m about {nominal:.4g} m"
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
class CatalogueTest:
    """Tests to failure of a muscle made of two rows of the catalogue. None: not tested.

    Attributes:
        name: unique in the catalogue.
        bladder: name of the bladder.
        braid: name of the braid.
        source: where the row comes from.
        burst_pressure: gauge pressure [Pa] at which it burst.
        burst_force: pull [N] at which it burst.
        tensile_force: pull [N] that broke it without pressure.
    """

    name: Text
    bladder: Text
    braid: Text
    source: Text
    burst_pressure: Positive | None = None
    burst_force: Positive | None = None
    tensile_force: Positive | None = None

    def __post_init__(self) -> None:
        if self.burst_pressure is None and self.burst_force is None and self.tensile_force is None:
            raise CatalogueError("a test needs burst_pressure, burst_force or tensile_force")


@dataclasses.dataclass(frozen=True)
class Catalogue:
    """Everything offered, each in the order of the files."""

    braids: tuple[CatalogueBraid, ...]
    bladders: tuple[CatalogueBladder, ...]
    tubes: tuple[CatalogueTube, ...]
    tests: tuple[CatalogueTest, ...] = ()
