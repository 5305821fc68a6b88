"""What a posterior returns: plain arrays, with what says how far they can be trusted."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .diagnostics import effective_size, effective_size_of_tails, r_hat

R_HAT, EFFECTIVE = 1.01, 400.0
"""What chains must show: R-hat at most, effective size at least (Vehtari et al. 2021)."""


@dataclasses.dataclass(frozen=True)
class Summary:
    """One parameter of a posterior, in SI.

    Attributes:
        mean, std: of the draws.
        low, high: ends of the central interval of 95 %.
        r_hat: rank-normalised split R-hat.
        effective_size, effective_size_of_tails: independent draws that the draws are worth.
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
        names: of the parameters that vary: nonlinear ones, coefficients, and where it was not known
            `noise` [N], or `noise_factor` on the standard deviations of the readings.
        kinds: of their units.
        samples: their values [SI], shape (chains, draws, parameters).
        divergent: trajectories that were given up: more than a few, and the draws miss a part of
            the posterior; shape (chains, draws).
        steps: of each trajectory, shape (chains, draws).
        log_density: of the sampled coordinates, but for a constant, shape (chains, draws).
        noise: standard deviation of a reading where it was known [N], or that factor.
        kept: part of the draws that satisfy the whole constraint; the others are left out.
        faces: number of active constraints, whose slack was sampled.
        joint: whether the coefficients were sampled and not integrated.
        name: of the specimen.
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
        """The draws of one parameter [SI].

        Raises:
            KeyError: no such parameter, with those there are.
        """
        if name not in self.names:
            raise KeyError(f"no parameter {name!r}; there are {', '.join(self.names)}")
        return self.samples[:, :, self.names.index(name)]

    @property
    def summary(self) -> dict[str, Summary]:
        """Every parameter by name."""
        return {name: _summary(self.draws(name)) for name in self.names}

    @property
    def r_hat(self) -> float:
        """The largest of all parameters."""
        return max(one.r_hat for one in self.summary.values())

    @property
    def effective_size(self) -> float:
        """The smallest of all parameters, in the middle and in the tails."""
        return min(
            min(one.effective_size, one.effective_size_of_tails) for one in self.summary.values()
        )

    @property
    def correlation(self) -> Float[np.ndarray, "parameters parameters"]:
        """Of the parameters over all draws."""
        return np.corrcoef(self.samples.reshape(-1, len(self.names)).T).reshape(
            2 * (len(self.names),)
        )

    @property
    def converged(self) -> bool:
        """Whether R-hat and effective size are what chains must show."""
        return self.r_hat <= R_HAT and self.effective_size >= EFFECTIVE

    def groups(self) -> dict[str, dict[str, Any]]:
        """Plain arrays as ArviZ reads them, by group, of shape (chains, draws).

        `arviz.from_dict(posterior.groups())` of ArviZ 1, `arviz.from_dict(**posterior.groups())`
        of ArviZ 0.
        """
        return {
            "posterior": {name: self.draws(name) for name in self.names},
            "sample_stats": {
                "diverging": self.divergent,
                "n_steps": self.steps,
                "lp": self.log_density,
            },
        }


def _summary(draws: Float[np.ndarray, "chains draws"]) -> Summary:
    low, high = np.quantile(draws, (0.025, 0.975))
    return Summary(
        mean=float(draws.mean()),
        std=float(draws.std(ddof=1)),
        low=float(low),
        high=float(high),
        r_hat=r_hat(draws),
        effective_size=effective_size(draws),
        effective_size_of_tails=effective_size_of_tails(draws),
    )
