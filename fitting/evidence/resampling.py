"""Bootstrap of an identification: what its numbers would be with the noise drawn again."""

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError, check_seed
from famjax.boundary.tasks import AnyExecutor, Store

from ..arguments import check_whole
from ..problem import Problem
from ..result import Identification, check_identified
from ..tasks import run_fits
from .refit import force_error, refit
from .validation import check_nothing_own

RESAMPLES = ("residual", "length", "specimen")
_CHUNK = 250  # replicates


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
    executor: AnyExecutor = None,
    resume: Path | str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Bootstrap:
    """Replicates of an identification, each a descent from the optimum, many at once.

    They are drawn and fitted in chunks of 250, which take about a millisecond of a core for each
    replicate of a map of a hundred readings, while a new process takes two seconds to start and
    trace: more than one pay from some ten thousand replicates on, or with ones that are alive
    already. Memory holds 8 bytes for each reading of each replicate.

    Args:
        result: from `identify`.
        replicates: number of them.
        resample: "residual": residuals, scaled for the parameters spent, drawn anew and added to
            the model, priors kept as they are (so that a parameter known from its prior alone
            hardly moves); "length": whole lengths of the map drawn with replacement; "specimen": whole
            specimens of `identify_together`. The last two need no belief in independent noise.
        seed: of the draws; the same seed gives the same numbers, whatever does them.
        executor: what does the chunks: this process, processes or a cluster, see
            `famjax.boundary.tasks.AnyExecutor`. A single chunk is done in this one, and so is a model
            of your own that cannot be sent to another, such as one with a function within a function.
        resume: JSONL file to which each finished chunk is written, created if missing; a bootstrap that was
            stopped goes on from there.
        progress: called with (replicates done, replicates).

    Returns:
        The replicates.

    Raises:
        InputError: an unknown way to draw, too few groups to draw from, fewer than two replicates,
            the file of another bootstrap, or the executor is gone.
    """
    if resample not in RESAMPLES:
        raise InputError(f"resample is one of {', '.join(RESAMPLES)}, got {resample!r}")
    check_identified(result)
    check_whole("replicates", replicates, 2)
    if resample == "specimen":
        check_nothing_own(result)
    draws = _Residuals.of(result) if resample == "residual" else _Groups.of(result, resample)
    chunks = [
        (check_seed(seed), first, min(_CHUNK, replicates - first))
        for first in range(0, replicates, _CHUNK)
    ]
    settings = {
        **result.fingerprint, "resample": resample, "replicates": replicates, "seed": seed,
    }  # fmt: skip
    store = Store(resume, "bootstrap", settings, len(chunks))
    run_fits(
        functools.partial(_replicates, result.problem, result.end.u, draws), chunks,
        executor=executor if len(chunks) > 1 else None, store=store,
        progress=progress and (lambda n, _: progress(min(n * _CHUNK, replicates), replicates)),
    )  # fmt: skip
    parts = list(store)
    samples, forces, good = (
        np.concatenate([part[name] for part in parts]) for name in ("samples", "forces", "good")
    )
    if good.sum() < 2:
        raise InputError(
            f"{good.sum()} of {replicates} replicates converged: the readings drawn do not determine "
            "the parameters; use resample='residual', or fix parameters"
        )
    problem = result.problem
    return Bootstrap(
        names=tuple(problem.names[k] for k in problem.free) + result.coefficient_names,
        samples=samples[good],
        failed=int((~good).sum()),
        forces=forces[good],
    )


@dataclasses.dataclass(frozen=True)
class _Residuals:
    """Draws of forces: the model's with standardised residuals drawn with replacement.

    Attributes:
        force: of the readings [N], shape (points,).
        model: of the model at them [N], likewise.
        scale: of a standardised residual [N], likewise.
        read: which are readings and not censored, likewise.
        standard: residuals to draw from, shape (readings,).
    """

    force: Float[np.ndarray, " points"]
    model: Float[np.ndarray, " points"]
    scale: Float[np.ndarray, " points"]
    read: Bool[np.ndarray, " points"]
    standard: Float[np.ndarray, " readings"]

    @classmethod
    def of(cls, result: Identification) -> "_Residuals":
        """Those of an identification."""
        force, scale = result.problem.force, 1 / result.problem.weight
        residual = force_error(result.problem, result.end)
        freedom, read = max(result.degrees_of_freedom, 1), result.problem.side == 0
        standard = (residual / scale)[read]
        standard = (standard - standard.mean()) * np.sqrt(standard.size / freedom)
        return cls(force, force + residual, scale, read, standard)

    def problems(
        self, problem: Problem, count: int, rng: np.random.Generator
    ) -> tuple[list[Problem], Float[np.ndarray, "count points"]]:
        """The problems of some draws, and the forces in them [N]."""
        drawn = rng.choice(self.standard, (count, self.force.size))
        forces = np.where(self.read, self.model + drawn * self.scale, self.force)
        return [problem.with_readings(force=force) for force in forces], forces


@dataclasses.dataclass(frozen=True)
class _Groups:
    """Draws of whole groups with replacement.

    Attributes:
        label: group of each reading, shape (points,).
        count: of the groups.
    """

    label: Int[np.ndarray, " points"]
    count: int

    @classmethod
    def of(cls, result: Identification, resample: str) -> "_Groups":
        """Lengths or specimens of an identification.

        Raises:
            InputError: fewer than three.
        """
        problem = result.problem
        which = np.repeat(np.arange(len(problem.parts), dtype=float), result.readings_of_parts)
        level = problem.levels("length") if resample == "length" else np.zeros(which.size)
        groups, label = np.unique(np.stack([which, level]), axis=1, return_inverse=True)
        count = groups.shape[1]
        if count < 3:
            raise InputError(
                f"drawing whole groups ({resample}) needs three or more of them, got {count}; use "
                "resample='residual'"
            )
        return cls(label.ravel(), count)

    def problems(
        self, problem: Problem, count: int, rng: np.random.Generator
    ) -> tuple[list[Problem], Float[np.ndarray, "count points"]]:
        """The problems of some draws, and the forces in them [N]."""
        drawn = rng.integers(self.count, size=(count, self.count))
        times = np.stack([np.bincount(row, minlength=self.count) for row in drawn])
        weights = np.sqrt(times[:, self.label].astype(float))
        forces = np.tile(problem.force, (count, 1))
        return [problem.with_readings(factor=weight) for weight in weights], forces


def _replicates(
    problem: Problem,
    u: Float[np.ndarray, " p"],
    draws: _Residuals | _Groups,
    chunk: tuple[int, int, int],
) -> dict[str, Any]:
    """The replicates (seed, first, count) of a problem from its optimum in the unit box."""
    seed, first, count = chunk
    drawn, forces = draws.problems(problem, count, np.random.default_rng((seed, first)))
    found = refit(drawn, [u[None]] * count)
    samples = np.concatenate([found.parameters[:, problem.free], found.x], axis=1)
    good = found.converged & np.isfinite(samples).all(axis=1)
    return {"samples": samples, "forces": found.residual + forces, "good": good}
