"""Bootstrap of an identification: what its numbers would be with the noise drawn again."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError, check_seed

from ..search.result import Identification
from .refit import force_error, refit
from .validation import check_nothing_own

RESAMPLES = ("residual", "length", "specimen")


@dataclasses.dataclass(frozen=True, repr=False)
class Bootstrap:
    """Replicates of an identification.

    Attributes:
        names: of the identified nonlinear parameters, then of the coefficients.
        samples: their values in every replicate [SI], shape (replicates, parameters).
        failed: replicates that did not converge; they are left out of `samples`.
        forces: of the model at every reading [N], shape (replicates, points).
    """

    names: tuple[str, ...]
    samples: Float[np.ndarray, "replicates parameters"]
    failed: int
    forces: Float[np.ndarray, "replicates points"]

    def __repr__(self) -> str:
        failed = f", {self.failed} failed" if self.failed else ""
        return f"Bootstrap({len(self.samples)} replicates{failed} of {', '.join(self.names)})"

    @property
    def stderr(self) -> dict[str, float]:
        """Standard deviation of each parameter over the replicates [SI]; nan if it never moved."""
        spread = self.samples.std(axis=0, ddof=1)
        moved = np.ptp(self.samples, axis=0) > 0
        return dict(zip(self.names, np.where(moved, spread, np.nan).tolist(), strict=True))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Percentile interval [SI] of a parameter."""
        ends = ((1 - level) / 2, (1 + level) / 2)
        low, high = np.quantile(self.samples[:, self.names.index(name)], ends)
        return float(low), float(high)

    def band(self, level: float = 0.95) -> Float[np.ndarray, "2 points"]:
        """Lower and upper end [N] of the model's force at every reading, shape (2, points)."""
        return np.quantile(self.forces, ((1 - level) / 2, (1 + level) / 2), axis=0)


def bootstrap(
    result: Identification,
    replicates: int = 200,
    *,
    resample: str = "residual",
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Bootstrap:
    """Replicates of an identification, each a descent from the optimum, all at once.

    Args:
        result: from `identify`.
        replicates: number of them.
        resample: "residual": residuals, scaled for the parameters spent, drawn anew and added to
            the model, priors kept as they are (so that a parameter known from its prior alone
            hardly moves); "length": whole lengths of the map drawn with replacement; "specimen": whole
            specimens of `identify_together`. The last two need no belief in independent noise.
        seed: of the draws.
        progress: called with (replicates done, replicates).

    Returns:
        The replicates.

    Raises:
        InputError: an unknown way to draw, too few groups to draw from, or fewer than two
            replicates.
    """
    if resample not in RESAMPLES:
        raise InputError(f"resample is one of {', '.join(RESAMPLES)}, got {resample!r}")
    if replicates < 2:
        raise InputError(f"a bootstrap needs two replicates or more, got {replicates}")
    if resample == "specimen":
        check_nothing_own(result)
    problem, rng = result.problem, np.random.default_rng(check_seed(seed))
    if resample == "residual":
        forces = _drawn_forces(result, replicates, rng)
        drawn = [problem.with_readings(force=force) for force in forces]
    else:
        weights = np.sqrt(_drawn_counts(result, resample, replicates, rng))
        forces = np.tile(problem.force, (replicates, 1))
        drawn = [problem.with_readings(factor=weight) for weight in weights]
    found = refit(drawn, [result.end.u[None]] * replicates, progress)
    samples = np.concatenate([found.parameters[:, problem.free], found.x], axis=1)
    good = found.converged & np.isfinite(samples).all(axis=1)
    if good.sum() < 2:
        raise InputError(
            f"{good.sum()} of {replicates} replicates converged: the readings drawn do not determine "
            "the parameters; use resample='residual', or fix parameters"
        )
    return Bootstrap(
        names=tuple(problem.names[k] for k in problem.free) + result.coefficient_names,
        samples=samples[good],
        failed=int((~good).sum()),
        forces=(found.residual + forces)[good],
    )


def _drawn_forces(
    result: Identification, replicates: int, rng: np.random.Generator
) -> Float[np.ndarray, "replicates points"]:
    """The model's forces with standardised residuals drawn with replacement."""
    force, scale = result.problem.force, 1 / result.problem.weight
    residual = force_error(result.problem, result.end)
    standard = residual / scale
    freedom, read = max(result.degrees_of_freedom, 1), result.problem.side == 0
    standard = standard[read]
    standard = (standard - standard.mean()) * np.sqrt(standard.size / freedom)
    drawn = rng.choice(standard, (replicates, residual.size))
    return np.where(read, force + residual + drawn * scale, force)


def _drawn_counts(
    result: Identification, resample: str, replicates: int, rng: np.random.Generator
) -> Float[np.ndarray, "replicates points"]:
    """How often each reading is drawn when whole groups are."""
    which = np.repeat(np.arange(len(result.problem.parts), dtype=float), result.readings_of_parts)
    level = result.problem.levels("length") if resample == "length" else np.zeros(which.size)
    groups, label = np.unique(np.stack([which, level]), axis=1, return_inverse=True)
    count = groups.shape[1]
    if count < 3:
        raise InputError(
            f"drawing whole groups ({resample}) needs three or more of them, got {count}; use "
            "resample='residual'"
        )
    drawn = rng.integers(count, size=(replicates, count))
    times = np.stack([np.bincount(row, minlength=count) for row in drawn])
    return times[:, label.ravel()].astype(float)
