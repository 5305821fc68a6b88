"""A posterior as tables, JSON and notes."""

from typing import Any

from famjax.boundary.units import from_si, unit_system

from .result import EFFECTIVE, R_HAT, Posterior

_DIVERGENT = 0.01  # of the draws: more, and a part of the posterior is missed
_UNLIKE = 1.5  # times the noise that was said: the readings say another


def posterior_as_dict(posterior: Posterior) -> dict[str, Any]:
    """The posterior as JSON-ready data in SI."""
    chains, draws, _ = posterior.samples.shape
    return {
        "chains": chains,
        "draws": draws,
        "units": "SI",
        "noise_known": posterior.noise,
        "kept": posterior.kept,
        "faces": posterior.faces,
        "coefficients": "sampled" if posterior.joint else "integrated",
        "divergent": int(posterior.divergent.sum()),
        "parameters": {
            name: {
                "mean": one.mean,
                "std": one.std,
                "interval_95": [one.low, one.high],
                "r_hat": one.r_hat,
                "effective_size": one.effective_size,
                "effective_size_of_tails": one.effective_size_of_tails,
            }
            for name, one in posterior.summary.items()
        },
        "correlations": posterior.correlation.tolist(),
    }


def posterior_table(posterior: Posterior, system: str) -> tuple[str, tuple[str, ...], list]:
    """Title, header and rows of text in a unit system."""
    rows = []
    for (name, one), kind in zip(posterior.summary.items(), posterior.kinds, strict=True):
        unit = unit_system(system)[kind]
        mean, std, low, high = (
            from_si(v, unit, kind) for v in (one.mean, one.std, one.low, one.high)
        )
        size = min(one.effective_size, one.effective_size_of_tails)
        rows.append(
            (name, unit, f"{mean:.5g}", f"{std:.2g}", f"{low:.5g} to {high:.5g}", f"{one.r_hat:.4f}",
             f"{size:.0f}")
        )  # fmt: skip
    chains, draws, _ = posterior.samples.shape
    how = "sampled" if posterior.joint else "integrated"
    title = f"Posterior, {chains} chains of {draws} draws, coefficients {how}"
    return title, ("parameter", "unit", "mean", "std.", "95 %", "R-hat", "effective"), rows


def posterior_warnings(posterior: Posterior, rmse: float) -> tuple[str, ...]:
    """What a reader must know of the draws.

    Args:
        posterior: from `sample`.
        rmse: of the fit, in the unit of the noise.
    """
    found = []
    if not posterior.converged:
        found.append(
            f"The chains of the posterior do not show enough: R-hat {posterior.r_hat:.3f} (at most "
            f"{R_HAT}), effective size {posterior.effective_size:.0f} (at least {EFFECTIVE:.0f}). Draw "
            "more (sample(draws=...)), or hold what the readings leave open."
        )
    divergent = float(posterior.divergent.mean())
    if divergent > _DIVERGENT:
        found.append(
            f"{100 * divergent:.1f} % of the trajectories of the posterior diverged: it has a place "
            "that the draws do not reach."
        )
    if posterior.noise is not None and rmse > _UNLIKE * posterior.noise:
        found.append(
            f"The readings scatter {rmse / posterior.noise:.2g} times as much about the model as the "
            "noise that was said: the posterior is that much too narrow. Say a larger noise."
        )
    return tuple(found)
