"""Sample the posterior of an identification.

Chains of the No-U-Turn sampler (BlackJAX) explore the density of `fitting.density`: the geometry is
sampled, and the coefficients are integrated.

References:
    Hoffman & Gelman 2014, JMLR 15; Betancourt 2017, arXiv:1701.02434 (multinomial trajectories,
    window adaptation as in Stan); Vehtari et al. 2021, Bayesian Analysis 16(2) (convergence diagnostics).
"""

import dataclasses
import functools
import importlib
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from famjax.boundary.errors import InputError, check_seed
from famjax.boundary.units import Quantity
from famjax.compile_options import quick_jit

from .arguments import check_whole
from .density import Density, Noise, density_of
from .parameters import base_name
from .problem import PureProblem
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
        effective_size, effective_size_of_tails: equivalent number of independent draws.
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
        names: names of the free parameters: nonlinear ones, coefficients, and an unknown `noise` [N], or
            `noise_factor` on the standard deviations of the readings.
        kinds: kinds of their units.
        samples: values [SI], shape (chains, draws, parameters).
        divergent: true for divergent trajectories, shape (chains, draws). If there are more than a few,
            the draws miss a part of the posterior.
        steps: number of steps of each trajectory, shape (chains, draws).
        log_density: log density of the sampled coordinates, up to a constant, shape (chains, draws).
        noise: known standard deviation of a reading [N], or the known factor.
        kept: share of the draws that satisfy the whole constraint; the others are discarded.
        faces: number of active constraints whose slack was sampled.
        joint: true if the coefficients were sampled and not integrated.
        name: name of the specimen.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    samples: Float[np.ndarray, "chains draws parameters"]
    divergent: Bool[np.ndarray, "chains draws"]
    steps: Float[np.ndarray, "chains draws"]
    log_density: Float[np.ndarray, "chains draws"]
    noise: float | None
    kept: float
    faces: int
    joint: bool
    name: str

    def __repr__(self) -> str:
        chains, draws, _ = self.samples.shape
        return (
            f"Posterior({self.name}: {chains} chains of {draws} draws, R-hat at most "
            f"{self.r_hat:.4f}, effective size at least {self.effective_size:.0f}; "
            f"{', '.join(self.names)})"
        )

    def draws(self, name: str) -> Float[np.ndarray, "chains draws"]:
        """Return the draws of one parameter [SI].

        Raises:
            KeyError: no such parameter.
        """
        if name not in self.names:
            raise KeyError(f"no parameter {name!r}; available: {', '.join(self.names)}")
        return self.samples[:, :, self.names.index(name)]

    @functools.cached_property
    def summary(self) -> dict[str, Summary]:
        """Summary of every parameter by name."""
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
        """Largest R-hat of all parameters."""
        return max(one.r_hat for one in self.summary.values())

    @property
    def effective_size(self) -> float:
        """Smallest effective size of all parameters, in the bulk and in the tails."""
        return min(
            min(one.effective_size, one.effective_size_of_tails) for one in self.summary.values()
        )

    @property
    def correlation(self) -> Float[np.ndarray, "parameters parameters"]:
        """Correlation of the parameters over all draws."""
        count = len(self.names)
        return np.corrcoef(self.samples.reshape(-1, count).T).reshape(count, count)

    @property
    def converged(self) -> bool:
        """True if R-hat and effective size meet the convergence criteria."""
        return self.r_hat <= R_HAT and self.effective_size >= EFFECTIVE

    def groups(self) -> dict[str, dict[str, Any]]:
        """Return plain arrays of shape (chains, draws) by group, for ArviZ.

        Use `arviz.from_dict(posterior.groups())` with ArviZ 1, and
        `arviz.from_dict(**posterior.groups())` with ArviZ 0.
        """
        return {
            "posterior": {name: self.draws(name) for name in self.names},
            "sample_stats": {
                "diverging": self.divergent,
                "n_steps": self.steps,
                "lp": self.log_density,
            },
        }


_DOUBLINGS = 8  # maximum per trajectory


Chains = tuple[Any, dict[str, Array]]
"""Sampler states of chains, with their step sizes and inverse mass matrices; leading axis of chains."""


class Drawn(NamedTuple):
    """Draws of chains, shape (chains, draws, ...).

    Attributes:
        parameters: nonlinear parameters [SI].
        x: coefficients.
        noise: standard deviation of a reading.
        held: true if the whole constraint holds.
        divergent: true for a divergent trajectory.
        steps: number of steps of the trajectory.
        log_density: log density of the sampled vector, up to a constant.
    """

    parameters: Float[Array, "chains draws q"]
    x: Float[Array, "chains draws n"]
    noise: Float[Array, "chains draws"]
    held: Bool[Array, "chains draws"]
    divergent: Bool[Array, "chains draws"]
    steps: Float[Array, "chains draws"]
    log_density: Float[Array, "chains draws"]


def load_blackjax() -> Any:
    """Import the sampler's package.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module("blackjax")
    except ModuleNotFoundError as error:
        if error.name != "blackjax":
            raise
        raise InputError(
            "sampling the posterior needs blackjax, which is not installed; install the extra "
            '"posterior": python -m pip install "famjax[posterior]"'
        ) from None


@quick_jit
def tuned_chains(density: Density, keys: Array, warmup: int) -> Chains:
    """Start dispersed chains, and tune each during warm-up draws that are discarded."""
    blackjax, d = load_blackjax(), density.box.mean.shape[0]

    def one(key: Array) -> Chains:
        start, tune = jax.random.split(key)
        z = 1.5 * jax.random.normal(start, (d,))
        z = jnp.where(jnp.isfinite(density(z)), z, 0.0)
        adapt = blackjax.window_adaptation(
            blackjax.nuts, density, is_mass_matrix_diagonal=False, target_acceptance_rate=0.9,
            max_num_doublings=_DOUBLINGS,
        )  # fmt: skip
        (state, tuning), _ = adapt.run(tune, z, num_steps=warmup)
        return state, {name: tuning[name] for name in ("step_size", "inverse_mass_matrix")}

    return jax.vmap(one)(keys)


@quick_jit
def drawn(
    density: Density, whole: PureProblem, chains: Chains, keys: Array, draws: int
) -> tuple[Chains, Drawn]:
    """Continue tuned chains by a number of draws, including coefficients and derived values.

    `whole` is the problem with its whole constraint.
    """
    kernel = load_blackjax().nuts.build_kernel()

    def step(chain: Chains, key: Array) -> tuple[Chains, Drawn]:
        (before, tuning), (move, own) = chain, jax.random.split(key)
        state, info = kernel(move, before, density, **tuning, max_num_doublings=_DOUBLINGS)
        v, _ = density.box(state.position)
        p, x, noise, held = density.draw(whole, v, own)
        found = Drawn(
            p, x, noise, held, info.is_divergent, 1.0 * info.num_integration_steps,
            state.logdensity,
        )  # fmt: skip
        return (state, tuning), found

    def one(chain: Chains, key: Array) -> tuple[Chains, Drawn]:
        return jax.lax.scan(step, chain, jax.random.split(key, draws))

    return jax.vmap(one)(chains, keys)


_ROUNDS = 20  # maximum rounds of draws, if the constraint rejects some
_ENOUGH = 0.9  # share of the requested draws that suffices


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
    """Draw from the posterior of an identification.

    Readings are the model's force plus independent normal noise. Nonlinear parameters are uniform within
    their bounds, times their priors; coefficients have a flat prior on the set allowed by the constraint,
    times theirs. Where the coefficients are normal, they are integrated exactly and drawn afterwards.
    Active constraints are sampled by their slack, and draws that violate another constraint are discarded,
    which gives the truncated posterior. With censored readings or a compliant rig, the coefficients are
    sampled with the other parameters. The sampler is NUTS (blackjax).

    Args:
        result: from `identify` or `identify_together`; with `objective="huber"` the readings keep their
            final weights.
        draws: draws of each chain after the warm-up; up to a tenth fewer if the constraint rejects many.
        warmup: tuning draws of each chain.
        chains: number of chains, from dispersed starts.
        noise: known standard deviation of a reading [N], or (low, high) [N] to sample it with a uniform
            logarithm. If readings have standard deviations, a multiple of these. By default it is sampled
            up to the largest force; the lower limit is the noise assumed in the fit (standard
            deviations, error of the laws for a chosen family, or noise of the priors), or else 1e-4 of
            the largest force.
        seed: seed of the draws.
        progress: called with (steps done, total).

    Returns:
        The draws, with R-hat and effective sizes.

    Raises:
        InputError: blackjax is not installed, the fit did not converge, coefficients are not determined,
            or the constraint rejects nearly all draws.
        RuntimeError: float64 is off.

    References:
        Golub & Pereyra 1973; Tobin 1958; Hoffman & Gelman 2014; Vehtari et al. 2021.
    """
    check_identified(result)
    load_blackjax()
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError('sampling needs float64: jax.config.update("jax_enable_x64", True)')
    for what, count, least in (("draws", draws, 4), ("warmup", warmup, 20), ("chains", chains, 1)):
        check_whole(what, count, least)
    if not result.converged:
        raise InputError(
            "the fit did not converge, so there is no optimum to sample around: see its warnings"
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
            f"only {kept} of {draws * len(found)} draws of a chain satisfy the constraint "
            f"{result.constraint!r}, which excludes nearly everything that the readings allow. Ask for "
            "fewer draws, or fit with another constraint or a lower order"
        )
    if progress is not None:
        progress(1, 1)
    whole_run: Drawn = jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=1), *found)
    first = [np.flatnonzero(row)[: min(kept, draws)] for row in whole_run.held]
    own = jax.tree.map(
        lambda leaf: np.stack([of[at] for of, at in zip(leaf, first, strict=True)]), whole_run
    )
    return _posterior(result, own, density, chosen, float(whole_run.held.mean()))


def _noise(result: Identification, noise: Noise | None) -> Noise:
    """Noise in the unit of the weighted residual, or the limits of its interval."""
    if noise is None:
        problem = result.problem
        largest = max(float(np.abs(part.force * part.weight).max()) for part in problem.parts)
        said = _weighted(result) or bool(problem.priors or problem.coefficient_priors)
        return (problem.noise if said else 1e-4 * largest), largest
    ends = noise if isinstance(noise, tuple) else (noise, noise)
    if not (len(ends) == 2 and 0 < ends[0] <= ends[1] < math.inf):
        raise InputError(f"noise must be one standard deviation > 0, or (low, high); got {noise}")
    return noise if isinstance(noise, tuple) and ends[0] < ends[1] else float(ends[0])


def _weighted(result: Identification) -> bool:
    """True if readings were weighted by standard deviations."""
    return max(float(part.weight.max()) for part in result.problem.parts) != 1.0


def _posterior(
    result: Identification, own: Drawn, density: Density, noise: Noise, kept: float
) -> Posterior:
    """Collect the draws of free parameters by name."""
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
    if density.noise_sampled:
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
        faces=len(density.slacks),
        joint=density.joint,
        name=result.data.specimen.name,
    )


def posterior_as_dict(posterior: Posterior) -> dict[str, Any]:
    """Posterior as JSON-ready data in SI."""
    chains, draws, _ = posterior.samples.shape
    parameters = {}
    for name, one in posterior.summary.items():
        parameters[name] = figures = dataclasses.asdict(one)
        figures["interval_95"] = [figures.pop("low"), figures.pop("high")]
    return {
        "chains": chains,
        "draws": draws,
        "units": "SI",
        "noise_known": posterior.noise,
        "kept": posterior.kept,
        "faces": posterior.faces,
        "coefficients": "sampled" if posterior.joint else "integrated",
        "divergent": int(posterior.divergent.sum()),
        "parameters": parameters,
        "correlations": posterior.correlation.tolist(),
    }


def posterior_table(posterior: Posterior, system: str) -> tuple[str, tuple[str, ...], list]:
    """Title, header and rows of a table in a unit system."""
    rows = []
    for (name, one), kind in zip(posterior.summary.items(), posterior.kinds, strict=True):
        figures = (one.mean, 5), (one.std, 2), (one.low, 5), (one.high, 5)
        mean, std, low, high = (Quantity(v, kind, n).in_units(system) for v, n in figures)
        size = min(one.effective_size, one.effective_size_of_tails)
        rows.append((name, mean, std, f"{low} to {high}", f"{one.r_hat:.4f}", f"{size:.0f}"))
    chains, draws, _ = posterior.samples.shape
    how = "sampled" if posterior.joint else "integrated"
    title = f"Posterior, {chains} chains of {draws} draws, coefficients {how}"
    return title, ("parameter", "mean", "std.", "95 %", "R-hat", "effective"), rows


def posterior_warnings(posterior: Posterior, rmse: float) -> tuple[str, ...]:
    """Warnings about the draws.

    Args:
        posterior: from `sample`.
        rmse: RMSE of the fit, in the unit of the noise.
    """
    found = []
    if not posterior.converged:
        found.append(
            f"The chains of the posterior did not converge: R-hat {posterior.r_hat:.3f} (at most "
            f"{R_HAT}), effective size {posterior.effective_size:.0f} (at least {EFFECTIVE:.0f}). Use "
            "more draws (sample(draws=...)), or hold parameters that the readings do not determine."
        )
    divergent = float(posterior.divergent.mean())
    if divergent > 0.01:
        found.append(
            f"{100 * divergent:.1f} % of the trajectories of the posterior diverged: the draws miss a part "
            "of it."
        )
    if posterior.noise is not None and rmse > 1.5 * posterior.noise:
        found.append(
            f"The readings scatter {rmse / posterior.noise:.2g} times as much about the model as the given "
            "noise: the posterior is too narrow by this factor. Give a larger noise."
        )
    return tuple(found)
