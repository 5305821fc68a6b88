"""The reference work's specimen, and the row in which one of its figures is held to ours.

Everything is in inch, psi, lbf and degrees, as printed. The figures come from
`reference/chambers2021.toml`, transcribed from Chambers 2021.
"""

import dataclasses
import functools
import tomllib
from pathlib import Path
from typing import Any

import jax.numpy as jnp

from famjax import AbstractGeometry, Bladder, Braid, EstimatedGeometry, Muscle, PolynomialMaterial
from famjax._elastic_braid import ElasticBraid
from famjax._measured_geometry import AverageDiameterGeometry, MeasuredGeometry
from famjax._profile import FourierProfile
from famjax._profile_family import MeasuredFamily
from famjax._thread import LinearThread

PRESSURES = (20.0, 40.0, 60.0, 80.0, 100.0)
"""Gauge pressures [psi] at which the work prints its tables of forces."""


@dataclasses.dataclass(frozen=True)
class Row:
    """One figure, published and computed.

    Attributes:
        table: of the work, as in "6.11", or what the figure belongs to.
        entry: which figure, and under which conditions.
        computed: ours, in `unit`.
        unit: "in", "psi", "1" for a pure number and so on.
        published: theirs; None where it was not given to us.
        tolerance: largest difference that counts as agreement, in `unit`; None with `published`.
    """

    table: str
    entry: str
    computed: float
    unit: str
    published: float | None = None
    tolerance: float | None = None

    @property
    def difference(self) -> float | None:
        """Computed minus published, None where nothing was published."""
        return None if self.published is None else self.computed - self.published

    @property
    def within(self) -> bool | None:
        """Whether the difference is within the tolerance; rounding of binary numbers forgiven."""
        if self.difference is None or self.tolerance is None:
            return None
        return abs(self.difference) <= self.tolerance * (1 + 1e-9)

    def as_dict(self) -> dict[str, Any]:
        """The row as the command's --json prints it."""
        names = ("table", "entry", "published", "computed", "unit", "tolerance", "within")
        return {name: getattr(self, name) for name in names}


@functools.cache
def printed() -> dict[str, Any]:
    """The figures of the reference work; see the comments in the file."""
    path = Path(__file__).parent / "reference" / "chambers2021.toml"
    return tomllib.loads(path.read_text(encoding="utf-8"))


def bladder() -> Bladder:
    """The latex tube of the 7/8 in specimen."""
    of = printed()["specimen"]
    return Bladder(
        of["active_length_in"], of["bladder_outer_diameter_in"], of["bladder_thickness_in"]
    )


def inelastic_braid() -> Braid:
    """The specimen's braid, its threads not stretching."""
    of = printed()["specimen"]
    return Braid(of["thread_length_B_in"], of["turns_N"], of["braid_thickness_in"])


def elastic_braid(softness: float = 1.0) -> ElasticBraid:
    """The specimen's braid with the modulus found in situ, 11.6e6 psi over `softness`."""
    of, braid = printed()["specimen"], inelastic_braid()
    modulus = of["thread_modulus_in_situ_linear_psi"] / softness
    thread = LinearThread(modulus, of["thread_area_in2"])
    return ElasticBraid(
        braid.rest_thread_length, braid.turns, braid.thickness, of["threads"], thread
    )


def profile(row: dict[str, Any], *, corrected: bool) -> FourierProfile:
    """One row of table 4.3: as printed, or with its printing errors corrected; not symmetrised."""
    w = row["w_corrected" if corrected else "w_as_printed"]
    b = list(row["b"])
    if not corrected:
        b[0] = row.get("b1_as_printed", b[0])
    return FourierProfile(row["a"][0], row["a"][1:], b, w)


def measured_family() -> MeasuredFamily:
    """Table 4.3, corrected and symmetrised, scaled in pressure by the elastic braid."""
    rest = printed()["specimen"]["active_length_in"]
    rows = printed()["profile_100psi"]
    return MeasuredFamily(
        jnp.array([rest * (1 - row["contraction"]) for row in rows]),
        [profile(row, corrected=True).symmetrised() for row in rows],
        100.0,
        elastic_braid(),
    )


@functools.cache
def geometries() -> dict[str, AbstractGeometry]:
    """The four geometries of the specimen, by name, in the order of the design."""
    family = measured_family()
    return {
        "estimated inelastic": EstimatedGeometry(inelastic_braid(), bladder()),
        "estimated elastic": EstimatedGeometry(elastic_braid(), bladder()),
        "measured average diameter": AverageDiameterGeometry(family, bladder()),
        "measured": MeasuredGeometry(family, bladder()),
    }


def latex() -> PolynomialMaterial:
    """The latex of chapter 6, psi."""
    return PolynomialMaterial(printed()["latex"]["E_psi"])


def muscles() -> dict[str, Muscle]:
    """The four geometries with the latex of chapter 6."""
    return {name: Muscle(geometry, latex()) for name, geometry in geometries().items()}
