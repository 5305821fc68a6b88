"""The pairs of a catalogue that can be built, and what is known of each."""

import dataclasses
import math

from ...boundary.errors import InputError
from ..catalogue import Catalogue, CatalogueBladder, CatalogueBraid
from ..combination import Feasibility, feasibility
from ..end_fitting import size_end_fittings
from ..swage_tube import TubeStrength
from .limits import SearchLimits


@dataclasses.dataclass(frozen=True)
class BuildablePair:
    """A bladder under a braid, with its swage tube and what was tested. Nan: not known.

    Attributes:
        bladder: row of the catalogue.
        braid: row of the catalogue.
        fit: feasible, or boundary: usable by its source but at rest outside its jamming range.
        nominal_range: nominal diameters [m] of the braid at which it fits the bladder, from the
            least to the greatest; equal where the braid is sold as it is.
        tube: the strongest swage tube that fits, or None where none is asked for.
        tube_yield_load: [N], at which its section yields.
        burst_pressure: least [Pa] at which such a muscle burst.
        breaking_pull: least [N] that broke such a muscle, with or without pressure.
    """

    bladder: CatalogueBladder
    braid: CatalogueBraid
    fit: Feasibility
    nominal_range: tuple[float, float]
    tube: str | None
    tube_yield_load: float
    burst_pressure: float
    breaking_pull: float

    @property
    def name(self) -> str:
        """What a person calls it."""
        return f"{self.bladder.name} under {self.braid.name}"


def buildable_pairs(
    catalogue: Catalogue, limits: SearchLimits, strengths: list[TubeStrength]
) -> tuple[list[BuildablePair], dict[str, int]]:
    """The pairs that can be built, and how many others are left out for which reason.

    Args:
        catalogue: from `load_catalogue`.
        limits: of the search.
        strengths: of the catalogue's tubes, from `tube_strengths`.

    Returns:
        (pairs in the order of the catalogue, number of pairs left out by reason: "braid" does not
        fit the bladder, "end_fitting" no tube fits, "untested" a factor is asked for that is not
        known of the pair).

    Raises:
        InputError: an end-fitting is asked for, and the catalogue has no tubes.
    """
    if limits.end_fittings and not catalogue.tubes:
        raise InputError(
            "the catalogue has no swage tubes: add [[tube]] rows, or search without end-fittings"
        )
    yields = {strength.tube.name: strength.yield_load for strength in strengths}
    pairs: list[BuildablePair] = []
    left_out = {"braid": 0, "end_fitting": 0, "untested": 0}
    for braid in catalogue.braids:
        fitting = _fitting_tubes(catalogue, braid, limits) if limits.end_fittings else {}
        for bladder in catalogue.bladders:
            fit, nominal = _fit(bladder, braid)
            tubes = fitting.get(bladder.name, [])
            if fit is Feasibility.INFEASIBLE:
                left_out["braid"] += 1
            elif limits.end_fittings and not tubes:
                left_out["end_fitting"] += 1
            else:
                tube = max(tubes, key=yields.__getitem__, default=None)
                pair = BuildablePair(
                    bladder, braid, fit, nominal, tube, yields.get(tube or "", math.nan),
                    *_tested(catalogue, bladder, braid),
                )  # fmt: skip
                if _unknown(pair, limits):
                    left_out["untested"] += 1
                else:
                    pairs.append(pair)
    return pairs, left_out


def _fitting_tubes(
    catalogue: Catalogue, braid: CatalogueBraid, limits: SearchLimits
) -> dict[str, list[str]]:
    """Names of the tubes that can be swaged onto each bladder under a braid."""
    found: dict[str, list[str]] = {}
    for diameter in sorted({bladder.diameter for bladder in catalogue.bladders}):
        for one in size_end_fittings(
            catalogue, braid, diameter, allowed_bore_stretch=limits.bore_stretch
        ):
            if one.feasible:
                found.setdefault(one.bladder.name, []).append(one.tube.name)
    return found


def _fit(
    bladder: CatalogueBladder, braid: CatalogueBraid
) -> tuple[Feasibility, tuple[float, float]]:
    """Whether the braid fits the bladder, and the nominal diameters [m] at which it does."""
    nominal = braid.nominal_diameter
    if braid.made_to_order_range is None:
        return feasibility(bladder.diameter, braid), (nominal, nominal)
    # The angles at which it jams are kept: its diameters there go with the nominal one.
    smallest, largest = (limit / nominal for limit in braid.diameter_range)
    least = max(braid.made_to_order_range[0], bladder.diameter / largest)
    greatest = min(braid.made_to_order_range[1], bladder.diameter / smallest)
    fit = Feasibility.FEASIBLE if least <= greatest else Feasibility.INFEASIBLE
    return fit, (least, greatest)


def _tested(
    catalogue: Catalogue, bladder: CatalogueBladder, braid: CatalogueBraid
) -> tuple[float, float]:
    """Least burst pressure [Pa] and least pull [N] that broke a muscle of the pair, or nan."""
    tests = [t for t in catalogue.tests if (t.bladder, t.braid) == (bladder.name, braid.name)]
    bursts = [t.burst_pressure for t in tests if t.burst_pressure is not None]
    pulls = [p for t in tests for p in (t.burst_force, t.tensile_force) if p is not None]
    return min(bursts, default=math.nan), min(pulls, default=math.nan)


def _unknown(pair: BuildablePair, limits: SearchLimits) -> bool:
    """Whether a factor is asked for that nothing is known of."""
    known = {
        "burst_factor": not math.isnan(pair.burst_pressure),
        "pull_factor": not math.isnan(pair.breaking_pull),
        "thread_factor": pair.braid.breaking_load is not None,
    }
    return any(getattr(limits, name) > 0 and not there for name, there in known.items())
