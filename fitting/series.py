"""Fit one model to a series of muscles that differ only in length, and predict new lengths.

Families are compared by leaving out each specimen in turn. The best model of a single specimen need not
apply to others: its deadband and dead length absorb whatever is peculiar to that muscle, and distort the
estimated compliance of the rig.
"""

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

import famjax
from famjax.boundary.errors import InputError, class_named

from .arguments import check_mapping, check_whole
from .bands import Column, muscle_spread, pull
from .data import ForceData, several_maps
from .families import LawGiven
from .identification import solve
from .ladder import Candidate, as_cylinder, believed, law_of, numbers_of, options_of
from .mechanics import check_ends, equilibrium_options
from .parameters import Parameter
from .posing import Geometry, Posed, pose
from .race import Tried, descended, preferred, ranked
from .result import Identification
from .validation import LeftOut, force_error, leave_out_each

DEFAULT_LAWS = ("linear", "mooney-rivlin", "ogden")
"""Laws of a series, in order of preference."""

BETWEEN = 0.02
"""Standard deviation between specimens of a series, relative to the largest force. Readings of one specimen
share an error, so each specimen has the same weight."""

FROM_ONE = 0.06
"""Standard deviation of readings about a prediction based on one specimen of a different length, relative
to the largest force and excluding the disagreement between models. It was chosen so that the bands contain
at least 95 % of the readings. In 18 predictions of one muscle from another, among five muscles 12 to 28 cm
long, they contain 96 %."""

_EQUAL = (
    "Every specimen has the same weight, regardless of the number and standard deviations of its readings: "
    "specimens differ by more than the noise in the forces."
)


@dataclasses.dataclass(frozen=True)
class Series:
    """A model of a series of muscles.

    Attributes:
        name: description of the family that predicts other specimens best.
        law: name of its law.
        specimens: identification of each specimen; all parameters are shared.
        others: the same identifications with a compliant rig; predictions are the weighted mean of both.
        weights: weights of the first model and the others, which sum to 1, see `_weights`.
        tried: all families; the first one is the chosen one.
        left_out: errors of the mean prediction for each held-out specimen.
    """

    name: str
    law: str
    specimens: tuple[Identification, ...]
    others: tuple[tuple[Identification, ...], ...]
    weights: tuple[float, ...]
    tried: tuple[Tried, ...]
    left_out: LeftOut

    @property
    def candidates(self) -> dict[str, float]:
        """RMSE [N] of every family on held-out specimens."""
        return {one.candidate.name: one.left_out["specimen"].rmse for one in self.tried}

    @property
    def between(self) -> float:
        """Standard deviation [N] of readings of a new specimen about their prediction.

        It follows from the held-out specimens, each of which is predicted from one specimen fewer than a
        new muscle would be. The mean of n - 1 specimens with standard deviation s differs from a new
        specimen by s sqrt(1 + 1/(n - 1)).
        """
        n = len(self.specimens)
        left_out = float(np.sqrt(np.mean(self.left_out.group_rmse**2)))
        return left_out * math.sqrt(1 - 1 / n**2)

    def predict(
        self, rest_length: float, length: Column, pressure: Column
    ) -> tuple[Column, Column]:
        """Predict the force of a new muscle as measured by the rig, with its standard deviation.

        The standard deviation is the larger of that between specimens, which includes parameter errors,
        and that due to parameter errors by linear theory.

        Args:
            rest_length: L0 [m] of the muscle.
            length: active lengths [m].
            pressure: gauge pressures [Pa].

        Returns:
            (force, standard deviation), both [N] and of shape (n,).
        """
        found = [
            pull(
                one.mounted,
                muscle_spread(one) if k == 0 else None,
                length, pressure, rest_length=rest_length,
            )
            for k, (one, *_) in enumerate((self.specimens, *self.others))
        ]  # fmt: skip
        force = np.average([force for force, _ in found], axis=0, weights=self.weights)
        return force, np.maximum(found[0][1], self.between)


def identify_series(
    data: Sequence[ForceData],
    *,
    laws: Sequence[LawGiven] | LawGiven = DEFAULT_LAWS,
    parameters: Mapping[str, Parameter] | None = None,
    constraint: str = "drucker",
    geometry: Geometry | None = None,
    terms: famjax.terms.AbstractForceTerm | None = None,
    ends: str = "cylinder",
    starts: int = 8,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> Series:
    """Find the model of a series that predicts each specimen best from the others.

    Every law is fitted to all specimens together with shared parameters, with and without a deadband, and
    again with each specimen left out. A few lengths cannot show whether the rig is compliant, so
    predictions are the mean of those with a rigid and a compliant rig, weighted by their held-out errors.
    Of the families with a held-out error of at most 1.5 times the smallest, the first in the order of the
    laws is chosen.

    Three specimens with 24 readings each take about ten seconds.

    Args:
        data: force maps of at least two specimens with different names, measured in one rig.
        laws: laws in order of preference, each as for `identify`: a name, `module:Class`, a class or a
            material; "linear" and "cubic" are polynomials.
        parameters: see `identify`; these settings apply to all families. `end_length` is the dead
            length of rounded ends, which is the same for every rest length.
        constraint: constraint on the coefficients.
        geometry: class or function that wraps the estimated geometry of a specimen, see `identify`; it
            needs a method `cut_to_length`.
        terms: further force terms, shared by all specimens, see `identify`.
        ends: "equilibrium" also tries every law with the shape computed from mechanics, see `identify`.
        starts: number of starts for each fit.
        seed: random seed of the starts.
        progress: called with (task, families done, total).

    Returns:
        The model, with the error of every family.

    Raises:
        InputError: there are fewer than two specimens, a law is unknown, or `identify_together` rejects the
            data or options.
    """
    if isinstance(laws, str) or not isinstance(laws, Sequence):
        laws = (laws,)
    if isinstance(geometry, str):
        geometry = class_named(geometry, famjax.geometries.AbstractGeometry, "geometry")
    data = several_maps(data)
    check_whole("starts", starts, 1)
    check_mapping("parameters", parameters, "from names to fitting.Parameter")
    _check(data, laws, geometry)
    own = {k: v for k, v in (("geometry", geometry), ("terms", terms)) if v is not None}
    mechanics = check_ends(ends, own) == "equilibrium"
    alike = [_counting_alike(one, data) for one in data]
    said = dict(parameters or {})
    families = [rigs for rank, law in enumerate(laws) for rigs in _families(law, rank, said, own)]
    if mechanics:
        families += [
            (_of_mechanics(alike, law, rank, said, seed),) for rank, law in enumerate(laws)
        ]
    rigs = [rig for family in families for rig in family]
    if len({one.name for one in rigs}) < len(rigs):
        names = ", ".join(dict.fromkeys(one.law for one in rigs))
        raise InputError(
            f"each law of a series must be listed only once, but one of {names} is listed twice"
        )
    found = []
    for done, family in enumerate(families):
        if progress is not None:
            progress(family[0].name, done, len(families))
        judged = [_judged(alike, constraint, min(starts, 4), seed, one) for one in family]
        if sound := [one for one in judged if one is not None]:
            found.append(sorted(sound, key=lambda one: one.error))
    if not found:
        raise InputError(
            f"with each of {', '.join(one.name for one in rigs)}, the force is undefined at some reading "
            "of a held-out specimen: the other specimens do not determine the parameters. Fix some "
            "parameters (end_length, series_compliance), or add specimens"
        )
    largest = max(one.max_force for one in data)
    tried = ranked([_as_one(rigs) for rigs in found], largest)
    order = preferred(tried)
    chosen, kept = tried[order[0]], found[order[0]]
    if progress is not None:
        progress(f"identifying: {chosen.candidate.name}", len(families), len(families))
    posed = [_posed(alike, constraint, one.candidate) for one in kept]
    fits = [solve(one, one.starts(starts, seed), seed=seed) for one in posed]
    return Series(
        name=chosen.candidate.name, law=chosen.candidate.law, specimens=fits[0],
        others=tuple(fits[1:]), weights=_weights(kept), tried=tuple(tried[k] for k in order),
        left_out=chosen.left_out["specimen"],
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _Judged:
    """A law in a rigid or compliant rig, with its in-sample RMSE [N] and held-out errors."""

    candidate: Candidate
    rmse: float
    left_out: LeftOut

    @property
    def error(self) -> float:
        """RMSE [N] on held-out specimens, with equal weights."""
        return float(np.sqrt(np.mean(self.left_out.group_rmse**2)))


def _judged(
    data: Sequence[ForceData], constraint: str, starts: int, seed: int, candidate: Candidate
) -> _Judged | None:
    """Return the errors of a candidate; None if the other specimens do not determine every force."""
    posed = _posed(data, constraint, candidate)
    problem, best = posed.problem, descended(posed, starts, seed)
    kinds = {"specimen": (None, 2)}
    (found,) = leave_out_each([(problem, best.u)], kinds, seed=seed, settled=True)
    out = found.get("specimen")
    if out is None or not np.isfinite(out.error).all():
        return None
    return _Judged(candidate, float(np.sqrt(np.mean(force_error(problem, best) ** 2))), out)


def _posed(data: Sequence[ForceData], constraint: str, candidate: Candidate) -> Posed:
    asked = {"constraint": constraint, **candidate.options}
    return pose(data, parameters=candidate.parameters, **asked)


def _weights(rigs: Sequence[_Judged]) -> tuple[float, ...]:
    """Return the weights of a rigid and a compliant rig from their errors on held-out specimens.

    The likelihood of n errors of unknown scale is proportional to their root mean square to the power -n.
    Readings of one specimen share an error, so n is the number of specimens.
    """
    errors = np.array([one.error for one in rigs])
    likelihood = (errors / errors.min()) ** -float(rigs[0].left_out.group_rmse.size)
    return tuple((likelihood / likelihood.sum()).tolist())


def _as_one(rigs: Sequence[_Judged]) -> tuple[Candidate, float, dict[str, LeftOut]]:
    """Return a law averaged over both rigs as one family, with in-sample RMSE [N] and held-out errors."""
    weights = _weights(rigs)
    rmse = float(np.sqrt(np.average([one.rmse**2 for one in rigs], weights=weights)))
    error = np.average([one.left_out.error for one in rigs], axis=0, weights=weights)
    left_out = dataclasses.replace(rigs[0].left_out, error=error)
    return rigs[0].candidate, rmse, {"specimen": left_out}


def _check(data: Sequence[ForceData], laws: Sequence[LawGiven], geometry: Geometry | None) -> None:
    if len(data) < 2:
        raise InputError(
            f"a series needs force maps of at least two specimens, got {len(data)}. Fit a single "
            "specimen with famjax fit (identify), and predict other lengths with famjax predict "
            "--rest-length (cut_to_length)"
        )
    if not laws:
        raise InputError(f"a series needs a law, such as {', '.join(DEFAULT_LAWS)}; got none")
    if len({one.specimen.rest_length for one in data}) < 2:
        raise InputError(
            "specimens of a series must differ in rest length, or they contain no information about other "
            "lengths: use other specimens, or fit each with famjax fit (all at once with identify_together)"
        )
    never_cut = famjax.geometries.AbstractGeometry.cut_to_length
    if isinstance(geometry, type) and getattr(geometry, "cut_to_length", None) is never_cut:
        raise InputError(
            f"{geometry.__name__} must have a method cut_to_length(rest_length) to predict other lengths"
        )


def _families(
    law: LawGiven, rank: int, said: Mapping[str, Parameter], own: Mapping[str, Any]
) -> list[tuple[Candidate, ...]]:
    """Return a law with and without a deadband, each in a rigid and a compliant rig.

    A deadband or rig in `said` is not varied; the user's geometry and terms apply to all.
    """
    name = law if isinstance(law, str) else law_of(law).name
    rigs: list[dict[str, Parameter]] = [{}]
    if "series_compliance" not in said:
        rigs.append({"series_compliance": Parameter()})
    held, found = {"deadband_pressure": Parameter(value=0.0, vary=False, unit="Pa")}, []
    for deadband in (True,) if "deadband_pressure" in said else (True, False):
        base = believed(law) | ({} if deadband else held)
        found.append(
            tuple(
                Candidate(
                    name=", ".join(
                        [name, *(["compliant rig"] if rig else []), *([] if deadband else ["no deadband"])]
                    ),
                    law=name, rig=bool(rig), options={**options_of(law), **own}, bounds={},
                    parameters={**base, **rig, **said},
                    unknowns=numbers_of(law) + deadband + len(rig), rank=(rank, 1 - deadband),
                )
                for rig in rigs
            )
        )  # fmt: skip
    return found


def _of_mechanics(
    data: Sequence[ForceData], law: LawGiven, rank: int, said: Mapping[str, Parameter], seed: int
) -> Candidate:
    """Return a law with the shape computed from mechanics, ranked after all cylinders."""
    one, made = _families(law, rank, said, {})[0][0], options_of(law)
    options = equilibrium_options(data, made["law"], made.get("order"), None, one.parameters, seed)
    parameters = options.pop("parameters")
    return dataclasses.replace(
        one, name=f"{one.name}, shape from mechanics", options=options, parameters=parameters,
        unknowns=one.unknowns + 1, rank=(len(DEFAULT_LAWS) + rank, 0),
    )  # fmt: skip


def _counting_alike(data: ForceData, of: Sequence[ForceData]) -> ForceData:
    """Return the map with standard deviations that give every specimen the same weight."""
    largest, mean = max(one.max_force for one in of), np.mean([one.loaded.sum() for one in of])
    std = BETWEEN * largest * np.sqrt(data.loaded.sum() / mean)
    return dataclasses.replace(
        data, force_std=np.full(data.force.shape, std), notes=(*data.notes, _EQUAL)
    )


def accounts(
    candidates: Sequence[Candidate], data: ForceData, said: Collection[str]
) -> tuple[Candidate, ...]:
    """Select the families, with a deadband or a compliant rig, that can predict other lengths.

    Args:
        candidates: families of the ladder.
        data: the force map.
        said: names of the parameters set by the user.

    Returns:
        The families; none unless families with a rigid rig and with a compliant rig are both possible.
    """
    found = [as_cylinder(one, data, said) for one in candidates if one.law in DEFAULT_LAWS]
    return tuple(found) if {one.rig for one in found} == {False, True} else ()
