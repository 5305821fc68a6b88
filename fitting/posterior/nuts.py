"""Chains of the No-U-Turn sampler (blackjax) on a density: one program for all maps of a form.

References:
    Hoffman & Gelman 2014, JMLR 15; Betancourt 2017, arXiv:1701.02434 (multinomial trajectories,
    window adaptation as in Stan).
"""

import importlib
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from famjax.boundary.errors import InputError
from famjax.compile_options import quick_jit

from ..pure_problem import PureProblem
from .density import Density

_DISPERSED = 1.5  # standard deviations of the starts, in which the posterior has about one
_DOUBLINGS = 8  # of a trajectory: what needs longer ones has coordinates that do not suit it
_TARGET = 0.9  # acceptance, at which narrow places are passed without divergences


class Chains(NamedTuple):
    """Where chains are, with what they are tuned to; a leading axis of chains.

    Attributes:
        states: of the sampler.
        tuning: step size and inverse mass matrix.
    """

    states: Any
    tuning: Any


class Drawn(NamedTuple):
    """What chains drew, of shape (chains, draws, ...).

    Attributes:
        parameters: nonlinear ones [SI].
        x: coefficients.
        noise: standard deviation of a reading.
        held: whether the whole constraint holds.
        divergent: whether the trajectory was given up.
        steps: of the trajectory.
        log_density: of the sampled vector, but for a constant.
    """

    parameters: Float[Array, "chains draws q"]
    x: Float[Array, "chains draws n"]
    noise: Float[Array, "chains draws"]
    held: Bool[Array, "chains draws"]
    divergent: Bool[Array, "chains draws"]
    steps: Float[Array, "chains draws"]
    log_density: Float[Array, "chains draws"]


def load_blackjax() -> Any:
    """The sampler's package.

    Raises:
        InputError: it is not installed, with how to.
    """
    try:
        return importlib.import_module("blackjax")
    except ModuleNotFoundError as error:
        if error.name != "blackjax":
            raise
        raise InputError(
            "the posterior is sampled by blackjax, which is not installed; it comes with the extra "
            '"posterior": python -m pip install "famjax[posterior]"'
        ) from None


@quick_jit
def tuned_chains(density: Density, keys: Array, warmup: int) -> Chains:
    """Chains from dispersed starts, each tuned by itself in draws that are dropped."""
    blackjax, d = load_blackjax(), density.box.mean.shape[0]

    def one(key: Array) -> Chains:
        start, tune = jax.random.split(key)
        z = _DISPERSED * jax.random.normal(start, (d,))
        z = jnp.where(jnp.isfinite(density(z)), z, 0.0)
        adapt = blackjax.window_adaptation(
            blackjax.nuts, density, is_mass_matrix_diagonal=False, target_acceptance_rate=_TARGET,
            max_num_doublings=_DOUBLINGS,
        )  # fmt: skip
        (state, tuning), _ = adapt.run(tune, z, num_steps=warmup)
        return Chains(state, {name: tuning[name] for name in ("step_size", "inverse_mass_matrix")})

    return jax.vmap(one)(keys)


@quick_jit
def drawn(
    density: Density, whole: PureProblem, chains: Chains, keys: Array, draws: int
) -> tuple[Chains, Drawn]:
    """The next draws of each of tuned chains, with the coefficients and all else that follows.

    `whole` is the problem with its whole constraint.
    """
    kernel = load_blackjax().nuts.build_kernel()

    def step(chain: Chains, key: Array) -> tuple[Chains, Drawn]:
        move, own = jax.random.split(key)
        state, info = kernel(
            move, chain.states, density, **chain.tuning, max_num_doublings=_DOUBLINGS
        )
        v, _ = density.box(state.position)
        p, x, noise, held = density.draw(whole, v, own)
        found = Drawn(
            p, x, noise, held, info.is_divergent, 1.0 * info.num_integration_steps,
            state.logdensity,
        )  # fmt: skip
        return Chains(state, chain.tuning), found

    def one(chain: Chains, key: Array) -> tuple[Chains, Drawn]:
        return jax.lax.scan(step, chain, jax.random.split(key, draws))

    return jax.vmap(one)(chains, keys)
