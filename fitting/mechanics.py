"""The shape from mechanics as a family: braid, bladder and law between two fittings, nothing linear."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np

import famjax
from famjax.boundary.errors import InputError

from .arguments import check_names
from .data import ForceData
from .families import EstimatedSource, Law, LawGiven
from .ladder import LAWS, Candidate, believed, numbers_of, rest_length_prior
from .parameters import Entry, Parameter
from .posing import pose
from .response import Values
from .search import best_of, descend_all

ENDS = ("cylinder", "equilibrium")
"""What the ends of a muscle may be taken as."""
_FARTHEST = 5.0  # times the largest coefficient of the cylinder's fit, either way
_STARTS = 4
_LAW = "ogden"
_FITTING = (0.6, 1.4)  # of the braid at the end-fittings, in parts of the bore


def check_ends(ends: str, asked: Mapping[str, Any]) -> str:
    """The ends, refused where they are not known or do not go with what else is asked for.

    Raises:
        InputError: what is wrong.
    """
    if ends not in ENDS:
        raise InputError(f"ends must be one of {', '.join(ENDS)}, got {ends!r}")
    others = [name for name in ("geometry", "terms") if asked.get(name) is not None]
    others += ["dependence"] if asked.get("dependence", "fixed") != "fixed" else []
    others += ["own_law"] if asked.get("own_law") else []
    if ends == "equilibrium" and others:
        raise InputError(
            f"the shape from mechanics cannot be combined with {others[0]}: leave out {others[0]} or ends"
        )
    return ends


class EquilibriumSource(EstimatedSource):
    """Threads and bladder of an estimated geometry, between two end-fittings of one diameter.

    It reads what `EstimatedSource` does but for the ends, and `end_diameter`.
    """

    bore: tuple[float, float] = eqx.field(static=True, default=_FITTING)

    @classmethod
    def of(cls, data: ForceData) -> "EquilibriumSource":
        """Of a map's specimen.

        Raises:
            InputError: no nominal diameter, which places that of the fittings.
        """
        bore = data.specimen.nominal_diameter
        if bore is None:
            raise InputError(
                "the shape from mechanics needs the diameter at the end-fittings: give "
                "nominal_diameter of the specimen, or bounds of end_diameter"
            )
        return cls(data.specimen, bore=(_FITTING[0] * bore, _FITTING[1] * bore))

    @property
    def declared(self) -> dict[str, famjax.parameters.Declared]:
        """The diameter at the end-fittings."""
        low, high = self.bore
        return {
            "end_diameter": famjax.parameters.Declared("m", "end_diameter", "length", low, high)
        }

    def as_arrays(self) -> "EquilibriumSource":
        """The same source with the specimen's numbers as arrays."""
        plain = super().as_arrays()
        return EquilibriumSource(plain.specimen, plain.n_threads, plain.thread, self.bore)

    def muscle(
        self,
        values: Values,
        material: famjax.materials.AbstractMaterial,
        further: famjax.terms.SumOfTerms | None,
    ) -> famjax.AbstractMuscle:
        """The muscle of these values; it has no further terms."""
        del further
        cylinder = self.geometry(values)
        assert isinstance(cylinder, famjax.EstimatedGeometry)
        return famjax.EquilibriumMuscle(
            cylinder.braid, cylinder.bladder, material, end_diameter=values["end_diameter"],
            deadband_pressure=values["deadband_pressure"],
        )  # fmt: skip


class SearchedLaw(Law):
    """A law whose coefficients are searched as its other numbers are: the force is not affine in them.

    Attributes:
        limits: bounds [Pa] of the coefficients, by name.
    """

    limits: tuple[tuple[str, float, float], ...] = eqx.field(static=True, default=())

    @property
    def coefficients(self) -> dict[str, Entry]:
        """None."""
        return {}

    @property
    def shape(self) -> dict[str, Entry]:
        """All numbers of the law, by name."""
        found = {name: Entry(low, high, "stress") for name, low, high in self.limits}
        return {**super().shape, **found}


def equilibrium_options(
    data: Sequence[ForceData],
    law: LawGiven = "polynomial",
    order: int | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    parameters: Mapping[str, Parameter] | None = None,
    seed: int = 0,
    own: Sequence[str] = (),
) -> dict[str, Any]:
    """What `pose` is given to fit the shape from mechanics: law, geometry, parameters and constraint.

    The search starts at the cylinder of the same law that fits the maps best, with ends as wide as it is.

    Args:
        data: the maps.
        law: as in `identify`, and all that follows.
        order: of the polynomial law.
        bounds: intervals in SI by name.
        parameters: bounds, held values and priors.
        seed: of the starts of the cylinder's fit.
        own: parameters that each specimen has for itself.

    Raises:
        InputError: what `identify` refuses of the cylinder, or no diameter of the end-fittings.
    """
    own = check_names("own", own)
    of_fittings, said = {"end_diameter"}, {**(bounds or {}), **(parameters or {})}
    plain = {k: v for k, v in (bounds or {}).items() if k not in of_fittings}
    more = {k: v for k, v in (parameters or {}).items() if k not in of_fittings}
    cylinders = [name for name in own if name not in of_fittings]
    posed = pose(data, law=law, order=order, bounds=plain, parameters=more, own=cylinders)
    point = best_of(descend_all(posed.problem, posed.starts(_STARTS, seed))).point
    near = dict(zip(posed.problem.names, point.parameters.tolist(), strict=True))
    near |= dict(zip(posed.problem.linear, point.x.tolist(), strict=True))
    most = _FARTHEST * float(np.abs(point.x).max())
    limits = tuple(
        (name, max(one.min, -most), min(one.max, most))
        for name, one in posed.law.coefficients.items()
    )
    fittings = {name: Parameter() for name in of_fittings if name not in said}
    as_wide = {
        name.replace("braid", "end"): value
        for name, value in near.items()
        if "braid_diameter" in name
    }
    return {
        "law": SearchedLaw(posed.law.material, limits),
        "geometry": {one.specimen.name: EquilibriumSource.of(one) for one in data},
        "constraint": "none", "bounds": bounds, "parameters": {**(parameters or {}), **fittings},
        "near": near | as_wide, "own": own,
    }  # fmt: skip


def equilibrium_candidate(
    data: ForceData,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    parameters: Mapping[str, Parameter] | None = None,
    seed: int = 0,
) -> Candidate:
    """Ogden's law with the shape from mechanics, with the priors of the ladder; last of the families.

    Args:
        data: the map.
        bounds: as a user gave them.
        parameters: likewise.
        seed: of the starts of the cylinder's fit.

    Raises:
        InputError: as `equilibrium_options`.
    """
    known = {**believed(_LAW, data), "rest_length": rest_length_prior(data)}
    known = {name: one for name, one in known.items() if name not in (bounds or {})}
    options = equilibrium_options(
        (data,), _LAW, None, bounds, {**known, **(parameters or {})}, seed
    )
    said = {name: options.pop(name) for name in ("bounds", "parameters")}
    return Candidate(
        name=f"{_LAW}, shape from mechanics", law=_LAW, rig=False, options=options, **said,
        unknowns=numbers_of(_LAW) + 1, rank=(len(LAWS), 0),
    )  # fmt: skip
