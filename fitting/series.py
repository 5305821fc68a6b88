"""A series of muscles that differ only in length: one model for all, including new lengths.

What transfers from one length to another is decided by leaving each specimen out in turn. A model
that fits each specimen best by itself need not transfer: a deadband and a dead end make up for
whatever distinguishes one short muscle, and the rig's compliance must then be what it is not.
"""

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError, class_named

from .arguments import check_mapping, check_whole
from .bands import muscle_spread, pull
from .data import ForceData, several_maps
from .families import LawGiven
from .identification import solve
from .ladder import Candidate, as_cylinder, believed, law_of, numbers_of, options_of
from .mechanics import check_ends, equilibrium_options
from .parameters import Parameter
from .posing import Geometry, Posed, pose
from .race import Fitted, Tried, descended, preferred, ranked
from .result import Identification
from .validation import LeftOut, force_error, leave_out_each

DEFAULT_LAWS = ("linear", "mooney-rivlin", "ogden")
"""Laws of a series, in the order in which they are believed."""

BETWEEN = 0.02
"""Standard deviation, in parts of the largest force, by which specimens of a series differ. All
readings of one specimen are off together, so each specimen counts the same, however many it has."""

FROM_ONE = 0.06
"""Standard deviation, in parts of the largest force, of readings of a muscle about what one specimen of
another length says of it, the disagreement of the accounts apart. Set so that the bands of 18 pairs of five
muscles of 12 to 28 cm, each predicted from another, hold 95 % of the readings (96 %)."""

_COMPARED = 4  # starts of each family at most
_NO_DEADBAND = Parameter(value=0.0, vary=False, unit="Pa")
_EQUAL = (
    "Each specimen counts the same, whatever the number of its readings and their standard "
    "deviations: specimens differ by more than the noise of their forces."
)


@dataclasses.dataclass(frozen=True)
class Series:
    """A model of a series of muscles.

    Attributes:
        name: of the family that transfers best, in words.
        law: its law.
        specimens: the identification of each specimen; all parameters are shared.
        others: the same in a rig that gives way, where predictions are the weighted mean of both.
        weights: of the first and of the others, of sum 1, see `_weights`.
        tried: all families, the chosen one first.
        left_out: errors of the mean on each specimen, while it was left out.
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
        """RMSE [N] on the specimens left out, of every family that was tried."""
        return {one.candidate.name: one.left_out["specimen"].rmse for one in self.tried}

    @property
    def between(self) -> float:
        """Standard deviation [N] of the readings of a new specimen about their prediction.

        That of specimens left out, each of which was predicted from one fewer than a new one is: a
        mean of n - 1 that each differ by s, and a new one, are s sqrt(1 + 1/(n - 1)) apart.
        """
        n = len(self.specimens)
        left_out = float(np.sqrt(np.mean(self.left_out.group_rmse**2)))
        return left_out * math.sqrt(1 - 1 / n**2)

    def muscle(self, rest_length: float) -> famjax.MountedMuscle:
        """A muscle of the series with rest length L0 [m], in the same rig as the others."""
        one = self.specimens[0].mounted
        return one.with_muscle(famjax.cut_to_length(one.muscle, rest_length))

    def predict(
        self,
        rest_length: float,
        length: Float[np.ndarray, " n"],
        pressure: Float[np.ndarray, " n"],
        *,
        length_std: float = 0.0,
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Force of a new muscle as the rig would measure it, with its standard deviation.

        The standard deviation is that between specimens, which leaving one out shows with the error
        of the parameters in it, or that of parameters and lengths by linear theory where it is larger.

        Args:
            rest_length: L0 [m] of the muscle.
            length: lengths [m].
            pressure: gauge pressures [Pa].
            length_std: standard deviation of the lengths [m].

        Returns:
            (force, standard deviation), both [N] and of shape (n,).
        """
        found = [
            pull(
                one.mounted,
                muscle_spread(one) if k == 0 else None,
                length, pressure, rest_length=rest_length, length_std=length_std,
            )
            for k, (one, *_) in enumerate((self.specimens, *self.others))
        ]  # fmt: skip
        force = np.average([one.force for one in found], axis=0, weights=self.weights)
        return force, np.maximum(found[0].std, self.between)


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

    Every law is identified on all specimens together, with every parameter shared, with and without
    a deadband, and again without each of the specimens. Whether the rig gives way is not to be told
    from ends and lengths by specimens of a few lengths: predictions are the mean of a rigid rig and
    of one that gives way, weighted by their errors on the specimens left out. The family with the
    smallest error on them is chosen, or the first in the order of the laws of those within half of it.

    Three specimens of 24 readings take ten seconds.

    Args:
        data: force maps of two specimens or more, with different names, measured in one rig.
        laws: in the order in which they are believed, each as `identify` takes one: a name,
            `module:Class`, a class or a material; "linear" and "cubic" are polynomials.
        parameters: as in `identify`; what is named here is not varied. `end_length` is the dead
            length of rounded ends, the same at every length.
        constraint: on the coefficients.
        geometry: a class or function of the estimated geometry of each specimen, see `identify`; it
            needs a method `cut_to_length`.
        terms: further force terms, the same for every specimen; see `identify`.
        ends: "equilibrium" tries every law with the shape from mechanics as well, see `identify`.
        starts: number of starts, of each fit.
        seed: of the starts.
        progress: called with (what is done, families done, families).

    Returns:
        The model, with the error of every family.

    Raises:
        InputError: fewer than two specimens, an unknown law, or what `identify_together`
            refuses.
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
        raise InputError(f"each law of a series is tried once: got one of {names} twice")
    found, judged = [], []
    for one in rigs:
        if progress is not None:
            progress(one.name, len(judged), len(rigs))
        judged.append(_judged(alike, constraint, min(starts, _COMPARED), seed, one))
    of_rigs = iter(judged)
    for family in families:
        sound = [one for _, one in zip(family, of_rigs, strict=False) if one is not None]
        if sound:
            found.append(sorted(sound, key=lambda one: one.error))
    if not found:
        raise InputError(
            f"none of the families {', '.join(one.name for one in rigs)} has a force at every reading "
            "without each of the specimens: the others do not determine the parameters. Fix some "
            "(end_length, series_compliance), or give more specimens"
        )
    largest = max(one.max_force for one in data)
    tried = ranked([_as_one(rigs) for rigs in found], largest)
    order = preferred(tried)
    chosen, kept = tried[order[0]], found[order[0]]
    if progress is not None:
        progress(f"identifying: {chosen.candidate.name}", len(rigs), len(rigs))
    posed = [_posed(alike, constraint, one.candidate) for one in kept]
    fits = [solve(one, one.starts(starts, seed), seed=seed) for one in posed]
    return Series(
        name=chosen.candidate.name, law=chosen.candidate.law, specimens=fits[0],
        others=tuple(fits[1:]), weights=_weights(kept), tried=tuple(tried[k] for k in order),
        left_out=chosen.left_out["specimen"],
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _Judged:
    """A law in a rig that is rigid or gives way: RMSE [N] in sample, errors on specimens left out."""

    candidate: Candidate
    rmse: float
    left_out: LeftOut

    @property
    def error(self) -> float:
        """RMSE [N] on whole specimens left out, each of which counts the same."""
        return float(np.sqrt(np.mean(self.left_out.group_rmse**2)))


def _judged(
    data: Sequence[ForceData], constraint: str, starts: int, seed: int, candidate: Candidate
) -> _Judged | None:
    """Errors of a candidate; None if the other specimens do not determine every force."""
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
    """Weights of a rigid rig and of one that gives way, by their errors on whole specimens left out.

    The likelihood of n errors of unknown scale goes with their root mean square to the power of -n; the
    readings of one specimen are off together, so n is the number of specimens.
    """
    errors = np.array([one.error for one in rigs])
    likelihood = (errors / errors.min()) ** -float(rigs[0].left_out.group_rmse.size)
    return tuple((likelihood / likelihood.sum()).tolist())


def _as_one(rigs: Sequence[_Judged]) -> tuple[Candidate, float, dict[str, LeftOut]]:
    """The mean of a law in both rigs as one family: RMSE in sample [N], errors on specimens left out."""
    weights = _weights(rigs)
    rmse = float(np.sqrt(np.average([one.rmse**2 for one in rigs], weights=weights)))
    left_out = LeftOut.of_mean([one.left_out for one in rigs], weights)
    return rigs[0].candidate, rmse, {"specimen": left_out}


def _check(data: Sequence[ForceData], laws: Sequence[LawGiven], geometry: Geometry | None) -> None:
    if len(data) < 2:
        raise InputError(
            f"a series needs the force maps of two specimens or more, got {len(data)}. One is fitted by "
            "famjax fit (identify), and tells of another length by famjax predict --rest-length "
            "(cut_to_length)"
        )
    if not laws:
        raise InputError(f"a series needs a law, such as {', '.join(DEFAULT_LAWS)}; got none")
    if len({one.specimen.rest_length for one in data}) < 2:
        raise InputError(
            "all specimens have the same rest length, so they carry no information about another "
            "one. Give specimens of "
            "different lengths, or fit each by famjax fit (all at once by identify_together)"
        )
    never_cut = famjax.geometries.AbstractGeometry.cut_to_length
    if isinstance(geometry, type) and getattr(geometry, "cut_to_length", None) is never_cut:
        raise InputError(
            f"{geometry.__name__} needs a method cut_to_length(rest_length): a series predicts muscles "
            "of other lengths"
        )


def _families(
    law: LawGiven, rank: int, said: Mapping[str, Parameter], own: Mapping[str, Any]
) -> list[tuple[Candidate, ...]]:
    """A law with and without a deadband, each in a rigid rig and in one that gives way.

    What a user says of deadband or rig is not varied; a user's own geometry and terms are in all.
    """
    name = law if isinstance(law, str) else law_of(law).name
    rigs = [{}] if "series_compliance" in said else [{}, {"series_compliance": Parameter()}]
    found = []
    for deadband in (True,) if "deadband_pressure" in said else (True, False):
        base = believed(law) | ({} if deadband else {"deadband_pressure": _NO_DEADBAND})
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
    """A law with the shape from mechanics, after all cylinders."""
    one, made = _families(law, rank, said, {})[0][0], options_of(law)
    options = equilibrium_options(data, made["law"], made.get("order"), None, one.parameters, seed)
    parameters = options.pop("parameters")
    return dataclasses.replace(
        one, name=f"{one.name}, shape from mechanics", options=options, parameters=parameters,
        unknowns=one.unknowns + 1, rank=(len(DEFAULT_LAWS) + rank, 0),
    )  # fmt: skip


def _counting_alike(data: ForceData, of: Sequence[ForceData]) -> ForceData:
    """The map with weights such that every specimen counts the same."""
    largest, mean = max(one.max_force for one in of), np.mean([one.loaded.sum() for one in of])
    std = BETWEEN * largest * np.sqrt(data.loaded.sum() / mean)
    return dataclasses.replace(
        data, force_std=np.full(data.force.shape, std), notes=(*data.notes, _EQUAL)
    )


@dataclasses.dataclass(frozen=True)
class OtherLengths:
    """Prior beliefs about muscles of the same make and another length.

    Attributes:
        names: of the families.
        members: the muscle as each has it, in its rig.
        between: standard deviation [N] of a specimen about their mean, their disagreement apart.
    """

    names: tuple[str, ...]
    members: tuple[famjax.MountedMuscle, ...]
    between: float


def accounts(
    candidates: Sequence[Candidate], data: ForceData, said: Collection[str]
) -> tuple[Candidate, ...]:
    """The families that transfer, with a deadband and with a rig that gives way.

    Args:
        candidates: of the ladder.
        data: the map.
        said: parameters of which a user says something.

    Returns:
        The families; none where there is but one thing to make a muscle pull late.
    """
    found = [as_cylinder(one, data, said) for one in candidates if one.law in DEFAULT_LAWS]
    return tuple(found) if {one.rig for one in found} == {False, True} else ()


def other_lengths(families: Sequence[Fitted], max_force: float) -> OtherLengths | None:
    """Muscles of other lengths by the families that transfer, as cylinders of stiff threads.

    Args:
        families: of `accounts`, fitted to all readings.
        max_force: largest force measured [N].

    Returns:
        None where there are none.
    """
    if not families:
        return None
    return OtherLengths(
        names=tuple(one.candidate.name for one in families),
        members=tuple(one.mounted for one in families),
        between=FROM_ONE * max_force,
    )
