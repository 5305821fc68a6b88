"""The posterior of an identification: draws of everything that the data leave open."""

import math
from collections.abc import Callable

import jax
import numpy as np

from famjax.boundary.errors import InputError, check_seed

from ..arguments import check_whole
from ..parameters import base_name
from ..result import Identification, check_identified
from .density import Layout
from .nuts import Drawn, drawn, load_blackjax, tuned_chains
from .result import Posterior
from .setup import Noise, density_of

_ROUNDS = 20  # in which as many draws are made as are asked for, where the constraint refuses some
_ENOUGH = 0.9  # of the draws: no further round is made for what is missing of them
_LEAST = 1e-4  # of the largest force: the least noise that is taken to be possible


def sample(
    result: Identification,
    *,
    draws: int = 500,
    warmup: int = 400,
    chains: int = 4,
    noise: Noise | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Posterior:
    """Draws from the posterior of what was identified.

    Readings are the model's force plus independent normal noise. Nonlinear parameters are uniform
    within their bounds, times their priors; coefficients have a flat prior on the set that the
    constraint leaves them, times theirs. Where these are normal they are integrated exactly and drawn
    afterwards; active constraints are sampled by their slack, and a draw that violates any other is
    left out, so that what stays is the posterior with its truncation. With censored readings, or a
    rig that gives way, coefficients are sampled with the rest. The sampler is NUTS (blackjax).

    Args:
        result: from `identify` or `identify_together`; with `objective="huber"` the readings keep
            the weights found.
        draws: of each chain, after the warm-up; a tenth of them fewer where the constraint refuses
            that many.
        warmup: draws in which each chain is tuned.
        chains: number of them, from dispersed starts.
        noise: standard deviation of a reading [N] where it is known; (low, high) [N] where it is
            sampled, its logarithm uniform between them. Where readings have standard deviations
            the same as a multiple of these. None: sampled up to the largest force, from what was
            said in the fit on (standard deviations, with the error of the laws where a family was
            chosen, or the noise that priors were weighed against), otherwise from 1e-4 of the largest
            force on.
        seed: of the draws; the same seed gives the same draws.
        progress: called with (steps done, steps).

    Returns:
        The draws, with R-hat and effective sizes.

    Raises:
        InputError: blackjax is not installed, the fit did not converge, coefficients are left open,
            or the constraint leaves hardly any draws.
        RuntimeError: float64 is off.

    References:
        Golub & Pereyra 1973; Tobin 1958; Hoffman & Gelman 2014; Vehtari et al. 2021.
    """
    check_identified(result)
    load_blackjax()
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError("sampling needs float64, as the identification did")
    for what, count, least in (("draws", draws, 4), ("warmup", warmup, 20), ("chains", chains, 1)):
        check_whole(what, count, least)
    if not result.converged:
        raise InputError(
            "the fit did not converge, so that there is no optimum to sample around: see its notes"
        )
    chosen = _noise(result, noise)
    density, whole = density_of(result, chosen)
    tune, *later = jax.random.split(jax.random.key(check_seed(seed)), 1 + _ROUNDS)
    at, found, kept = tuned_chains(density, jax.random.split(tune, chains), warmup), [], 0
    for done, key in enumerate(later, 1):
        if progress is not None:
            progress(done, max(3, done + 1))
        at, new = drawn(density, whole, at, jax.random.split(key, chains), draws)
        found.append(jax.tree.map(np.asarray, new))
        kept = int(np.sum([one.held.sum(axis=1) for one in found], axis=0).min())
        if kept >= _ENOUGH * draws or kept * _ROUNDS < draws * done:
            break
    if kept < _ENOUGH * draws:
        raise InputError(
            f"of {draws * len(found)} draws of a chain {kept} satisfy the constraint "
            f"{result.constraint!r}: it cuts off nearly all of what the readings allow. Ask for "
            "fewer draws, or fit with another constraint or a lower order"
        )
    if progress is not None:
        progress(1, 1)
    whole_run: Drawn = jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=1), *found)
    first = [np.flatnonzero(row)[: min(kept, draws)] for row in whole_run.held]
    own = jax.tree.map(
        lambda leaf: np.stack([of[at] for of, at in zip(leaf, first, strict=True)]), whole_run
    )
    return _posterior(result, own, density.layout, chosen, float(whole_run.held.mean()))


def _noise(result: Identification, noise: Noise | None) -> Noise:
    """The noise in the unit of the weighted residual, or the ends of its interval."""
    if noise is None:
        problem = result.problem
        largest = max(float(np.abs(part.force * part.weight).max()) for part in problem.parts)
        said = _weighted(result) or bool(problem.priors or problem.coefficient_priors)
        return (problem.noise if said else _LEAST * largest), largest
    ends = noise if isinstance(noise, tuple) else (noise, noise)
    if not (len(ends) == 2 and 0 < ends[0] <= ends[1] < math.inf):
        raise InputError(
            f"the noise is a standard deviation > 0, or two of them, low and high; got {noise}"
        )
    return noise if isinstance(noise, tuple) and ends[0] < ends[1] else float(ends[0])


def _weighted(result: Identification) -> bool:
    """Whether readings were weighed against standard deviations, of theirs or of a choice's."""
    return max(float(part.weight.max()) for part in result.problem.parts) != 1.0


def _posterior(
    result: Identification, own: Drawn, layout: Layout, noise: Noise, kept: float
) -> Posterior:
    """The draws by name; what is held has none."""
    problem = result.problem
    known = {base_name(one.name): one.kind for one in result.estimates}
    names = [problem.names[k] for k in problem.free]
    kinds = [known[base_name(name)] for name in names]
    columns = [own.parameters[:, :, k] for k in problem.free]
    for k, name in enumerate(result.coefficient_names):
        if problem.coefficient_min[k] < problem.coefficient_max[k]:
            names.append(name)
            kinds.append(result.law.coefficients[problem.linear[k]].kind)
            columns.append(own.x[:, :, k])
    if layout.noise:
        weighted = _weighted(result)
        names.append("noise_factor" if weighted else "noise")
        kinds.append("number" if weighted else "force")
        columns.append(own.noise)
    return Posterior(
        names=tuple(names),
        kinds=tuple(kinds),
        samples=np.stack(columns, axis=-1),
        divergent=np.asarray(own.divergent),
        steps=np.asarray(own.steps),
        log_density=np.asarray(own.log_density),
        noise=None if isinstance(noise, tuple) else noise,
        kept=kept,
        faces=len(layout.slacks),
        joint=layout.joint,
        name=result.data.specimen.name,
    )
