"""Family of muscles whose shape is computed from mechanics; the force is nonlinear in all parameters."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np

import famjax
from famjax.boundary.errors import InputError

from .arguments import check_names
from .data import ForceData, Specimen
from .families import EstimatedSource, Law, LawGiven
from .ladder import LAWS, Candidate, believed, numbers_of, rest_length_prior
from .parameters import Entry, Parameter
from .posing import pose
from .response import Values
from .search import best_of, descend_all

ENDS = ("cylinder", "equilibrium")
"""Available models of the muscle ends."""
_FARTHEST = 5.0  # bound on coefficients, relative to the largest one of the cylinder fit
_STARTS = 4
_LAW = "ogden"
_FITTING = (0.6, 1.4)  # bounds of the braid diameter at the end-fittings, relative to the bore


def check_ends(ends: str, asked: Mapping[str, Any]) -> str:
    """Check that `ends` is valid and compatible with the other options, and return it.

    Raises:
        InputError: `ends` is unknown, or cannot be combined with another option.
    """
    if ends not in ENDS:
        raise InputError(f"ends must be one of {', '.join(ENDS)}, got {ends!r}")
    others = [name for name in ("geometry", "terms") if asked.get(name) is not None]
    if ends == "equilibrium" and others:
        raise InputError(
            f"ends='equilibrium' cannot be combined with {others[0]}: omit one of them"
        )
    return ends


class EquilibriumSource(EstimatedSource):
    """Source for a braid and bladder between two end-fittings with equal diameters.

    The parameters are those of `EstimatedSource` without the end effects, plus `end_diameter`.
    """

    bore: float = eqx.field(static=True)

    def __init__(self, specimen: Specimen) -> None:
        """Create the source for a specimen.

        Raises:
            InputError: the specimen has no nominal diameter to set the bounds of `end_diameter`.
        """
        super().__init__(specimen)
        if specimen.nominal_diameter is None:
            raise InputError(
                "the bounds on the diameter at the end-fittings depend on the nominal diameter, which is "
                "missing: set the specimen's nominal_diameter"
            )
        self.bore = specimen.nominal_diameter

    @property
    def declared(self) -> dict[str, famjax.parameters.Declared]:
        """Parameter for the diameter at the end-fittings."""
        low, high = (share * self.bore for share in _FITTING)
        return {
            "end_diameter": famjax.parameters.Declared("m", "end_diameter", "length", low, high)
        }

    def muscle(
        self,
        values: Values,
        material: famjax.materials.AbstractMaterial,
        further: famjax.terms.SumOfTerms | None,
    ) -> famjax.AbstractMuscle:
        """Build the muscle from these values; further terms are not supported."""
        del further
        cylinder = self.geometry(values)
        assert isinstance(cylinder, famjax.EstimatedGeometry)
        return famjax.EquilibriumMuscle(
            cylinder.braid, cylinder.bladder, material, end_diameter=values["end_diameter"],
            deadband_pressure=values["deadband_pressure"],
        )  # fmt: skip


class SearchedLaw(Law):
    """Law whose parameters are all found by the outer search, as the force is not affine in any of them.

    Attributes:
        limits: bounds [Pa] of the coefficients, by name.
    """

    limits: tuple[tuple[str, float, float], ...] = eqx.field(static=True, default=())

    @property
    def coefficients(self) -> dict[str, Entry]:
        """Empty, because the force is not linear in any coefficient."""
        return {}

    @property
    def shape(self) -> dict[str, Entry]:
        """All parameters of the law, by name."""
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
    """Return the options for `pose` that set up a fit with the shape computed from mechanics.

    The search starts from the best-fitting cylinder with the same law. The initial end diameter equals
    the diameter of that cylinder.

    Args:
        data: the maps.
        law: bladder law, see `identify`.
        order: order of the polynomial law.
        bounds: intervals in SI by name.
        parameters: bounds, fixed values and priors.
        seed: random seed for the starts of the cylinder fit.
        own: parameters with a separate value for each specimen.

    Raises:
        InputError: the cylinder fit is not possible, or the end diameter has no bounds.
    """
    own = check_names("own", own)
    bounds, parameters, end = dict(bounds or {}), dict(parameters or {}), "end_diameter"
    plain = {k: v for k, v in bounds.items() if k != end}
    more = {k: v for k, v in parameters.items() if k != end}
    cylinders = [name for name in own if name != end]
    posed = pose(data, law=law, order=order, bounds=plain, parameters=more, own=cylinders)
    point = best_of(descend_all(posed.problem, posed.starts(_STARTS, seed))).point
    near = dict(zip(posed.problem.names, point.parameters.tolist(), strict=True))
    near |= dict(zip(posed.problem.linear, point.x.tolist(), strict=True))
    most = _FARTHEST * float(np.abs(point.x).max())
    limits = tuple(
        (name, max(one.min, -most), min(one.max, most))
        for name, one in posed.law.coefficients.items()
    )
    if end not in bounds:
        parameters.setdefault(end, Parameter())
    near |= {k.replace("braid", "end"): v for k, v in near.items() if "braid_diameter" in k}
    return {
        "law": SearchedLaw(posed.law.material, limits),
        "geometry": {one.specimen.name: EquilibriumSource(one.specimen) for one in data},
        "constraint": "none", "bounds": bounds, "parameters": parameters, "near": near, "own": own,
    }  # fmt: skip


def equilibrium_candidate(
    data: ForceData,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    parameters: Mapping[str, Parameter] | None = None,
    seed: int = 0,
) -> Candidate:
    """Return the candidate with Ogden's law, the shape computed from mechanics and the ladder's priors.

    It ranks last among the families.

    Args:
        data: the map.
        bounds: the user's bounds.
        parameters: the user's parameters.
        seed: random seed for the starts of the cylinder fit.

    Raises:
        InputError: see `equilibrium_options`.
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
