"""Sample the posterior of an identification.

Chains of the No-U-Turn sampler (BlackJAX) explore the density defined in `fitting.density`.

References:
    Hoffman & Gelman 2014, JMLR 15; Betancourt 2017, arXiv:1701.02434 (multinomial trajectories,
    window adaptation as in Stan); Vehtari et al. 2021, Bayesian Analysis 16(2) (convergence diagnostics).
"""

import dataclasses
import functools
import importlib
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from famjax.boundary.errors import InputError, check_seed
from famjax.compile_options import quick_jit

from .arguments import check_float64, check_whole
from .density import Density, Noise, density_of
from .parameters import base_name
from .result import Identification, check_identified

R_HAT, EFFECTIVE = 1.01, 400.0
"""Convergence criteria: maximum R-hat and minimum effective size (Vehtari et al. 2021)."""


@dataclasses.dataclass(frozen=True)
class Summary:
    """Summary of one parameter of a posterior, in SI.

    Attributes:
        mean, std: mean and standard deviation of the draws.
        low, high: limits of the central 95 % interval.
        r_hat: split R-hat of the chains; 1 if they agree.
        effective_size, effective_size_of_tails: equivalent number of independent draws, in the bulk and in
            the tails.
    """

    mean: float
    std: float
    low: float
    high: float
    r_hat: float
    effective_size: float
    effective_size_of_tails: float


@dataclasses.dataclass(frozen=True, repr=False)
class Posterior:
    """Draws from the posterior of an identification.

    Attributes:
        names: names of the free parameters: nonlinear ones, coefficients and, if the noise is unknown,
            `noise` [N] or `noise_factor`, which multiplies the standard deviations of the readings.
        kinds: type of unit of each parameter.
        samples: values [SI], shape (chains, draws, parameters).
        divergent: true for divergent trajectories, shape (chains, draws). If there are more than a few,
            the draws miss part of the posterior.
        noise: known standard deviation of a reading [N], or known value of the factor; None if sampled.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    samples: Float[np.ndarray, "chains draws parameters"]
    divergent: Bool[np.ndarray, "chains draws"]
    noise: float | None

    def __repr__(self) -> str:
        chains, draws, _ = self.samples.shape
        return (
            f"posterior, {chains} chains of {draws} draws, R-hat at most {self.r_hat:.4f}, effective size "
            f"at least {self.effective_size:.0f}"
        )

    def draws(self, name: str) -> Float[np.ndarray, "chains draws"]:
        """Return the draws of one parameter [SI].

        Raises:
            ValueError: there is no such parameter.
        """
        return self.samples[:, :, self.names.index(name)]

    @functools.cached_property
    def summary(self) -> dict[str, Summary]:
        """Summary of every parameter, keyed by name."""
        diagnostics, draws = load_blackjax().diagnostics, self.samples
        # The halves of a drifting chain differ.
        half = draws.shape[1] // 2
        halves = np.concatenate([draws[:, :half], draws[:, -half:]])
        low, high = np.quantile(draws, (0.025, 0.975), axis=(0, 1))
        size = diagnostics.effective_sample_size
        tails = [
            size(1.0 * (halves <= end)) for end in np.quantile(draws, (0.05, 0.95), axis=(0, 1))
        ]
        columns = (
            draws.mean(axis=(0, 1)), draws.std(axis=(0, 1), ddof=1), low, high,
            diagnostics.potential_scale_reduction(halves), size(halves), np.min(tails, axis=0),
        )  # fmt: skip
        rows = zip(*(np.atleast_1d(column).tolist() for column in columns), strict=True)
        return {name: Summary(*row) for name, row in zip(self.names, rows, strict=True)}

    @property
    def r_hat(self) -> float:
        """Largest R-hat over all parameters."""
        return max(one.r_hat for one in self.summary.values())

    @property
    def effective_size(self) -> float:
        """Smallest effective size over all parameters, in the bulk and in the tails."""
        summary = self.summary.values()
        return min(min(one.effective_size, one.effective_size_of_tails) for one in summary)

    @property
    def converged(self) -> bool:
        """True if R-hat and effective size meet the convergence criteria."""
        return self.r_hat <= R_HAT and self.effective_size >= EFFECTIVE


_DOUBLINGS = 8  # maximum per trajectory


Drawn = tuple[Array, Array, Array, Array]
"""Parameters [SI], coefficients, noise, divergence; the first axes are chains and draws."""


def load_blackjax() -> Any:
    """Import and return blackjax, which contains the sampler.

    Raises:
        InputError: blackjax is not installed.
    """
    try:
        return importlib.import_module("blackjax")
    except ModuleNotFoundError as error:
        if error.name != "blackjax":
            raise
        raise InputError(
            "sampling the posterior needs blackjax, which is not installed; install it with "
            'python -m pip install "famjax[posterior]"'
        ) from None


@quick_jit
def drawn(density: Density, keys: Array, warmup: int, draws: int) -> Drawn:
    """Start dispersed chains, tune each during a discarded warm-up, and return the draws."""
    blackjax, d = load_blackjax(), density.box.mean.shape[0]
    adapt = blackjax.window_adaptation(
        blackjax.nuts, density, is_mass_matrix_diagonal=False, target_acceptance_rate=0.9,
        max_num_doublings=_DOUBLINGS,
    )  # fmt: skip

    def chain(key: Array) -> Drawn:
        start, tune, later = jax.random.split(key, 3)
        z = 1.5 * jax.random.normal(start, (d,))
        z = jnp.where(jnp.isfinite(density(z)), z, 0.0)
        (state, tuned), _ = adapt.run(tune, z, num_steps=warmup)
        nuts = blackjax.nuts(density, **tuned)

        def step(state: Any, key: Array) -> tuple[Any, Drawn]:
            state, info = nuts.step(key, state)
            return state, (*density.draw(state.position), info.is_divergent)

        return jax.lax.scan(step, state, jax.random.split(later, draws))[1]

    return jax.vmap(chain)(keys)


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
    """Sample the posterior of an identification.

    Readings are assumed to be the model's force plus independent normal noise. Nonlinear parameters have a
    uniform prior within their bounds, and coefficients a flat prior on the set allowed by the constraint;
    both are multiplied by any priors stated in the fit. Active constraints are sampled in terms of their
    slack. A trajectory that reaches another constraint is stopped there and counted as divergent. The
    sampler is NUTS (blackjax).

    Args:
        result: fit from `identify` or `identify_together`; with `objective="huber"` the readings keep their
            final weights.
        draws: number of draws per chain after the warm-up.
        warmup: number of tuning draws per chain.
        chains: number of chains, each from a different, widely dispersed start.
        noise: known standard deviation of a reading [N], or (low, high) [N] to sample it with a log-uniform
            prior. If the readings have standard deviations, `noise` is a factor that multiplies them. By
            default it is sampled between the noise assumed in the fit and the largest force. The noise
            assumed in the fit is based on the standard deviations, on the error of the laws (for a chosen
            family), or on the noise given with priors. Without any of these, the lower limit is 1e-4 of the
            largest force.
        seed: random seed of the draws.
        progress: called with (0, 1) before sampling.

    Returns:
        The draws, with R-hat and effective sizes.

    Raises:
        InputError: blackjax is not installed, the fit did not converge, or the data do not determine
            the coefficients.
        RuntimeError: float64 is off.

    References:
        Tobin 1958; Hoffman & Gelman 2014; Vehtari et al. 2021.
    """
    check_identified(result)
    load_blackjax()
    check_float64()
    for what, count, least in (("draws", draws, 4), ("warmup", warmup, 20), ("chains", chains, 1)):
        check_whole(what, count, least)
    if not result.converged:
        raise InputError("the fit did not converge, so it has no posterior: see its warnings")
    chosen = _noise(result, noise)
    density = density_of(result, chosen)
    if progress is not None:
        progress(0, 1)
    keys = jax.random.split(jax.random.key(check_seed(seed)), chains)
    parameters, x, sigma, divergent = map(np.asarray, drawn(density, keys, warmup, draws))
    problem = result.problem
    known = {base_name(one.name): one.kind for one in result.estimates}
    columns = {
        problem.names[k]: (known[base_name(problem.names[k])], parameters[:, :, k])
        for k in problem.free
    }
    for k, name in enumerate(result.coefficient_names):
        columns[name] = result.law.coefficients[problem.linear[k]].kind, x[:, :, k]
    if isinstance(chosen, tuple):
        weighted = _weighted(result)
        columns["noise_factor" if weighted else "noise"] = "number" if weighted else "force", sigma
    kinds, samples = zip(*columns.values(), strict=True)
    return Posterior(
        names=tuple(columns),
        kinds=kinds,
        samples=np.stack(samples, axis=-1),
        divergent=divergent,
        noise=None if isinstance(chosen, tuple) else chosen,
    )


def _noise(result: Identification, noise: Noise | None) -> Noise:
    """Return the noise in the unit of the weighted residual, or its (low, high) limits."""
    if noise is None:
        problem = result.problem
        largest = max(float(np.abs(part.force * part.weight).max()) for part in problem.parts)
        said = _weighted(result) or bool(problem.priors or problem.coefficient_priors)
        return (problem.noise if said else 1e-4 * largest), largest
    ends = noise if isinstance(noise, tuple) else (noise, noise)
    if not (len(ends) == 2 and 0 < ends[0] <= ends[1] < math.inf):
        raise InputError(f"noise must be a standard deviation > 0, or (low, high); got {noise}")
    return noise if isinstance(noise, tuple) and ends[0] < ends[1] else float(ends[0])


def _weighted(result: Identification) -> bool:
    """Return True if readings were weighted by standard deviations."""
    return max(float(part.weight.max()) for part in result.problem.parts) != 1.0


def posterior_as_dict(posterior: Posterior) -> dict[str, Any]:
    """Return a summary of the posterior as JSON-ready data in SI units."""
    chains, draws, _ = posterior.samples.shape
    return {
        "chains": chains,
        "draws": draws,
        "units": "SI",
        "noise_known": posterior.noise,
        "divergent": int(posterior.divergent.sum()),
        "parameters": {name: dataclasses.asdict(one) for name, one in posterior.summary.items()},
    }


def posterior_warnings(posterior: Posterior, rmse: float) -> tuple[str, ...]:
    """Return warnings about the draws.

    Args:
        posterior: result of `sample`.
        rmse: RMSE of the fit, in the unit of the noise.
    """
    found = []
    if not posterior.converged:
        found.append(
            f"The posterior chains did not converge: R-hat is {posterior.r_hat:.3f} (must be at most "
            f"{R_HAT}), and the effective size is {posterior.effective_size:.0f} (must be at least "
            f"{EFFECTIVE:.0f}). Use more draws (sample(draws=...)), or fix parameters that the readings "
            "do not determine."
        )
    divergent = float(posterior.divergent.mean())
    if divergent > 0.01:
        found.append(
            f"{100 * divergent:.1f} % of the posterior trajectories diverged, so the draws miss part of "
            "the posterior."
        )
    if posterior.noise is not None and rmse > 1.5 * posterior.noise:
        found.append(
            f"The scatter of the readings about the model is {rmse / posterior.noise:.2g} times the stated "
            "noise, so the posterior is too narrow by this factor. State a larger noise."
        )
    return tuple(found)
