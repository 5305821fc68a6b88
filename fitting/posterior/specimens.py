"""Posteriors of several identifications: each a task, on any executor."""

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from famjax.boundary.errors import InputError, check_seed
from famjax.boundary.tasks import AnyExecutor, Store

from ..result import Identification
from ..tasks import run_fits
from .nuts import load_blackjax
from .result import Posterior
from .sampling import sample
from .setup import Noise


def sample_each(
    results: Sequence[Identification],
    *,
    draws: int = 500,
    warmup: int = 400,
    chains: int = 4,
    noise: Noise | None = None,
    seed: int = 0,
    executor: AnyExecutor = None,
    resume: Path | str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Posterior, ...]:
    """Draws from the posteriors of several identifications, those of `sample` of each by itself.

    The first posterior of a process takes some twenty seconds of a core, nearly all of them to
    compile, and each further one of a map of the same form two. More than one process pay from some
    ten maps of one form on, and from two of different forms.

    Args:
        results: from `identify`; those of `identify_together` have one posterior, that of any of them.
        draws: of each chain, see `sample`, and so are all that follow.
        warmup: draws in which each chain is tuned.
        chains: number of them.
        noise: standard deviation of a reading [N] of all of them, or its interval.
        seed: of the draws of each.
        executor: what samples, each identification a task: this process, processes or a cluster, see
            `famjax.boundary.tasks.AnyExecutor`.
        resume: JSONL file to which each finished posterior is written, created if missing; what was stopped
            goes on from there.
        progress: called with (posteriors done, posteriors).

    Returns:
        The draws of each.

    Raises:
        InputError: what `sample` refuses, the file of others, or the executor is gone.
        RuntimeError: float64 is off.
    """
    load_blackjax()
    check_seed(seed)
    if not results:
        raise InputError("give the identifications whose posteriors are sampled; got none")
    given = {"draws": draws, "warmup": warmup, "chains": chains, "noise": noise, "seed": seed}
    settings = {**given, "results": [one.fingerprint for one in results]}
    store = Store(resume, "posterior", settings, len(results))
    run_fits(
        functools.partial(_sampled, given), results, executor=executor, store=store,
        progress=progress, names=[one.data.specimen.name for one in results],
    )  # fmt: skip
    return tuple(_posterior(part) for part in store)


def _sampled(options: Mapping[str, Any], result: Identification) -> dict[str, Any]:
    return vars(sample(result, **options))


def _posterior(part: Mapping[str, Any]) -> Posterior:
    """From the part of a store, in which tuples are lists."""
    return Posterior(**{**part, "names": tuple(part["names"]), "kinds": tuple(part["kinds"])})
