"""A series of muscles, the same but for their length: one model of all, and of lengths never seen.

What transfers from one length to another is decided by leaving each specimen out in turn. A model
that fits each specimen best by itself need not transfer: a deadband and a dead end make up for
whatever distinguishes one short muscle, and the rig's compliance must then be what it is not.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError

from ..data.force_data import ForceData
from ..families.parameters import Parameter
from ..search.identification import identify_together
from ..search.result import Identification
from .pull import pull
from .spread import muscle_spread
from .validation import Validation, validate

SERIES_LAWS: dict[str, dict[str, Any]] = {
    "linear": {"law": "polynomial", "order": 1},
    "mooney-rivlin": {"law": "mooney-rivlin"},
    "ogden": {"law": "ogden"},
    "cubic": {"law": "polynomial", "order": 3},
    "saturating": {"law": "saturating"},
}
"""Laws that a series may have, by name: options of `identify_together`."""

DEFAULT_LAWS = ("linear", "mooney-rivlin", "ogden")

_SHARED: dict[str, Parameter] = {
    "series_compliance": Parameter(),
    "deadband_pressure": Parameter(value=0.0, vary=False, unit="kPa"),
}
_EQUAL = (
    "Each reading counts the same, whatever its standard deviation: specimens differ by more than "
    "the noise of their forces."
)


@dataclasses.dataclass(frozen=True)
class Series:
    """One model of a series of muscles.

    Attributes:
        law: name of the law that transfers best.
        specimens: the identification of each specimen; all parameters are shared.
        validation: each specimen predicted from the others.
        candidates: leave-one-specimen-out RMSE [N] of every law that was tried, by name; nan
            where a fit without a specimen did not converge.
    """

    law: str
    specimens: tuple[Identification, ...]
    validation: Validation
    candidates: dict[str, float]

    @property
    def between(self) -> float:
        """Standard deviation [N] between a specimen and its prediction from the others."""
        return self.validation.rmse

    def muscle(self, rest_length: float) -> famjax.MountedMuscle:
        """A muscle of the series with the rest length L0 [m], in the rig of the others."""
        one = self.specimens[0]
        muscle = famjax.cut_to_length(one.muscle, rest_length)
        return famjax.MountedMuscle(muscle, one.series_compliance)

    def predict(
        self,
        rest_length: float,
        length: Float[np.ndarray, " n"],
        pressure: Float[np.ndarray, " n"],
        *,
        length_std: float = 0.0,
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Force of a muscle never seen, as the rig would measure it, with its standard deviation.

        The standard deviation is made of three: between specimens (by leaving one out), of the
        parameters (linear theory), and of the lengths.

        Args:
            rest_length: L0 [m] of the muscle.
            length: lengths [m].
            pressure: gauge pressures [Pa].
            length_std: standard deviation of the lengths [m].

        Returns:
            (force, standard deviation), both [N] and of shape (n,).
        """
        one = self.specimens[0]
        found = pull(
            famjax.MountedMuscle(one.muscle, one.series_compliance),
            muscle_spread(one),
            length,
            pressure,
            rest_length=rest_length,
            length_std=length_std,
        )
        return found.force, np.hypot(found.std, self.between)


def identify_series(
    data: Sequence[ForceData],
    *,
    laws: Sequence[str] = DEFAULT_LAWS,
    parameters: Mapping[str, Parameter] | None = None,
    constraint: str = "drucker",
    box: str = "physical",
    starts: int = 8,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> Series:
    """The model of a series that predicts each specimen from the others best.

    Every law is identified on all specimens together, with every parameter shared, and again
    without each of them; the law of the smallest error on what was left out is kept. The choice
    makes that error a little too small: three laws, not many.

    Args:
        data: force maps of two specimens or more, with different names, measured in one rig.
        laws: names of `SERIES_LAWS`.
        parameters: as in `identify`. Unless named here, the compliance of the rig takes part and
            the deadband is held at zero, as the two cannot be told apart in short muscles.
            `end_length` is the dead length of rounded ends, the same at every length.
        constraint: on the coefficients.
        box: of the standard bounds.
        starts: number of starts, of each fit.
        seed: of the starts.
        progress: called with (what is done, laws done, laws).

    Returns:
        The model, with the error of every law.

    Raises:
        InputError: fewer than two specimens, an unknown law, or what `identify_together` refuses.
    """
    if len(data) < 2:
        raise InputError(
            f"a series needs the force maps of two specimens or more, got {len(data)}; for one use "
            "identify, and cut_to_length for another length"
        )
    unknown = [law for law in laws if law not in SERIES_LAWS]
    if unknown or not laws:
        raise InputError(
            f"laws of a series are {', '.join(SERIES_LAWS)}, got {unknown[0] if unknown else 'none'}"
        )
    if len({one.specimen.rest_length for one in data}) < 2:
        raise InputError(
            "all specimens have one rest length: they say nothing of another. Give specimens of "
            "different lengths, or use identify_together"
        )
    table = {**_SHARED, **(parameters or {})}
    alike = [_counting_alike(one) for one in data]
    found: dict[str, tuple[tuple[Identification, ...], Validation]] = {}
    for done, law in enumerate(laws):
        if progress is not None:
            progress(law, done, len(laws))
        fits = identify_together(
            alike, own=(), parameters=table, constraint=constraint, box=box, starts=starts,
            seed=seed, **SERIES_LAWS[law],
        )  # fmt: skip
        found[law] = fits, validate(fits[0], "specimen", starts=starts)
    errors = {law: _error(fits, left) for law, (fits, left) in found.items()}
    best = best_law(errors)
    return Series(best, *found[best], errors)


def best_law(errors: Mapping[str, float]) -> str:
    """The law of the smallest error [N], nan where a fit did not converge.

    Raises:
        InputError: no law has an error.
    """
    if not np.isfinite(list(errors.values())).any():
        raise InputError(
            f"none of the laws {', '.join(errors)} converged without each of the specimens: the "
            "others do not determine the parameters. Fix some (end_length, series_compliance), or "
            "give more specimens"
        )
    return min(errors, key=lambda law: np.nan_to_num(errors[law], nan=np.inf))


def _counting_alike(data: ForceData) -> ForceData:
    if data.force_std is None:
        return data
    return dataclasses.replace(data, force_std=None, notes=(*data.notes, _EQUAL))


def _error(fits: tuple[Identification, ...], left_out: Validation) -> float:
    """The error without a specimen, where every fit is one."""
    sound = fits[0].converged and bool(np.all(left_out.refits.converged))
    return left_out.rmse if sound else np.nan
