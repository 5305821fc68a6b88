"""What a catalogue offers: braids, bladders, swage tubes, and the tests of muscles made of them."""

import dataclasses
import math

from ..boundary.errors import InputError

NOMINAL_ANGLE = math.pi / 4
"""Braid angle [rad] at which a braid has its nominal diameter: 45 deg."""


class CatalogueError(InputError):
    """What is wrong with a catalogue file or an option, where, and what to write instead."""


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
        made_to_order_range: least and greatest nominal diameter [m] to which it is woven on order, or
            None where it is sold as it is. The angles at which it jams stay those of the row.
        n_threads: n [-], of both families, or None: the file does not say.
        breaking_load: of one thread [N], or None.
    """

    name: str
    nominal_diameter: float
    thickness: float
    diameter_range: tuple[float, float]
    boundary_range: tuple[float, float]
    angle_range: tuple[float, float] | None
    source: str
    made_to_order_range: tuple[float, float] | None = None
    n_threads: float | None = None
    breaking_load: float | None = None


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

    name: str
    diameter: float
    thickness: float
    source: str
    coefficients: tuple[float, ...] | None = None
    coefficients_source: str | None = None

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
        modulus: Young's modulus [Pa], or None.
        modulus_source: where the modulus comes from, or None.
        yield_stress: [Pa], or None.
        yield_stress_source: where the yield stress comes from, or None.
        free_length: [m], free to bend while it is pushed through the die, or None.
        supported_length: [m], what a support leaves free of it, or None.
        source: where the row comes from.
    """

    name: str
    outer_diameter: float
    thickness: float
    swage_reduction: float
    modulus: float | None
    modulus_source: str | None
    yield_stress: float | None
    yield_stress_source: str | None
    free_length: float | None
    supported_length: float | None
    source: str


@dataclasses.dataclass(frozen=True)
class CatalogueTest:
    """Tests to failure of a muscle made of two rows of the catalogue. None: not tested.

    Attributes:
        name: unique in the catalogue.
        bladder: name of the bladder.
        braid: name of the braid.
        burst_pressure: gauge pressure [Pa] at which it burst.
        burst_force: pull [N] at which it burst.
        tensile_force: pull [N] that broke it without pressure.
        source: where the row comes from.
    """

    name: str
    bladder: str
    braid: str
    burst_pressure: float | None
    burst_force: float | None
    tensile_force: float | None
    source: str


@dataclasses.dataclass(frozen=True)
class Catalogue:
    """Everything offered, each in the order of the files."""

    braids: tuple[CatalogueBraid, ...]
    bladders: tuple[CatalogueBladder, ...]
    tubes: tuple[CatalogueTube, ...]
    tests: tuple[CatalogueTest, ...] = ()
