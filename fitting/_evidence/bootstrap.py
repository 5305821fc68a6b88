"""Bootstrap of an identification: what its numbers would be with the noise drawn again."""

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._errors import InputError
from .._search.result import Identification
from .refit import Readings, refit
from .validation import check_nothing_own

RESAMPLES = ("residual", "length", "specimen")


@dataclasses.dataclass(frozen=True)
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
    search = result.search
    readings = Readings.of(search).repeated(replicates)
    rng = np.random.default_rng(seed)
    if resample == "residual":
        drawn = jnp.asarray(_drawn_forces(result, replicates, rng))
        readings = dataclasses.replace(readings, force=drawn)
    else:
        weights = np.sqrt(_drawn_counts(result, resample, replicates, rng))
        readings = dataclasses.replace(readings, weights=readings.weights * weights)
    start = np.tile(result.unit_optimum, (replicates, 1))
    found = refit(search, readings, start, progress)
    moving = list(search.free)
    laws = found.x.reshape(replicates, -1)
    samples = np.concatenate([found.parameters[:, moving], laws], axis=1)
    good = found.converged & np.isfinite(samples).all(axis=1)
    if good.sum() < 2:
        raise InputError(
            f"{good.sum()} of {replicates} replicates converged: the readings drawn do not determine "
            "the parameters; use resample='residual', or fix parameters"
        )
    return Bootstrap(
        names=tuple(search.names[k] for k in moving) + _coefficient_names(result, laws.shape[1]),
        samples=samples[good],
        failed=int((~good).sum()),
        forces=np.asarray(found.residual + readings.force)[good],
    )


def _coefficient_names(result: Identification, count: int) -> tuple[str, ...]:
    names = tuple(result.law.coefficients)
    nodes = count // len(names)
    return (
        names if nodes == 1 else tuple(f"{n}_at_node_{k + 1}" for k in range(nodes) for n in names)
    )


def _residuals(result: Identification) -> Float[np.ndarray, " points"]:
    """Model minus reading at the optimum, of all specimens of the search."""
    search = result.search
    one = Readings.of(search).repeated(1)
    return np.asarray(refit(search, one, result.unit_optimum[None]).residual[0])


def _drawn_forces(
    result: Identification, replicates: int, rng: np.random.Generator
) -> Float[np.ndarray, "replicates points"]:
    """The model's forces with standardised residuals drawn with replacement."""
    parts = result.search.problem.parts
    force = np.concatenate([np.asarray(part.force) for part in parts])
    scale = np.concatenate([1 / np.asarray(part.weights).max(axis=0) for part in parts])
    residual = _residuals(result)
    standard = residual / scale
    freedom = max(result.degrees_of_freedom, 1)
    standard = (standard - standard.mean()) * np.sqrt(residual.size / freedom)
    drawn = rng.choice(standard, (replicates, residual.size))
    return force + residual + drawn * scale


def _drawn_counts(
    result: Identification, resample: str, replicates: int, rng: np.random.Generator
) -> Float[np.ndarray, "replicates points"]:
    """How often each reading is drawn when whole groups are."""
    parts = result.search.problem.parts
    keys = [
        np.stack([np.full(part.force.shape[0], float(k)),
                  np.asarray(part.length_level) if resample == "length" else np.zeros(part.force.shape[0])])
        for k, part in enumerate(parts)
    ]  # fmt: skip
    groups, label = np.unique(np.concatenate(keys, axis=1), axis=1, return_inverse=True)
    count = groups.shape[1]
    if count < 3:
        raise InputError(
            f"drawing whole groups ({resample}) needs three or more of them, got {count}; use "
            "resample='residual'"
        )
    drawn = rng.integers(count, size=(replicates, count))
    times = np.stack([np.bincount(row, minlength=count) for row in drawn])
    return times[:, label.ravel()].astype(float)
