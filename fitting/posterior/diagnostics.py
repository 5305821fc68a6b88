"""Whether chains agree, and how many independent draws they are worth.

References:
    Vehtari, Gelman, Simpson, Carpenter & Buerkner 2021, Bayesian Analysis 16(2): rank-normalised
    split R-hat, bulk and tail effective sample size. Geyer 1992, Statistical Science 7(4).
"""

import numpy as np
from jaxtyping import Float

_TAILS = (0.05, 0.95)


def r_hat(draws: Float[np.ndarray, "chains draws"]) -> float:
    """Rank-normalised split R-hat of one quantity: 1 where chains agree, in place and in spread.

    Args:
        draws: at least four of each chain.

    Returns:
        The larger of that of the draws and that of their distances from the median; nan where
        nothing varies.

    >>> rng = np.random.default_rng(0)
    >>> alike = rng.normal(size=(4, 500))
    >>> r_hat(alike) < 1.01 < 1.1 < r_hat(alike + np.arange(4)[:, None])
    True
    """
    halves = _split(draws)
    return max(_ratio(_normal_scores(one)) for one in (halves, abs(halves - np.median(halves))))


def effective_size(draws: Float[np.ndarray, "chains draws"]) -> float:
    """Independent draws that show the middle of the distribution as well (bulk); nan for a constant."""
    return _size(_normal_scores(_split(draws)))


def effective_size_of_tails(draws: Float[np.ndarray, "chains draws"]) -> float:
    """Independent draws that show the 5 % and 95 % quantiles as well."""
    ends = np.quantile(draws, _TAILS)
    return min(_size(_split(1.0 * (draws <= end))) for end in ends)


def _split(draws: np.ndarray) -> Float[np.ndarray, "halves half"]:
    half = draws.shape[1] // 2
    return np.concatenate([draws[:, :half], draws[:, -half:]])


def _normal_scores(draws: np.ndarray) -> np.ndarray:
    from scipy.special import ndtri  # noqa: PLC0415 -- a fit without a posterior would pay 0.4 s
    from scipy.stats import rankdata  # noqa: PLC0415

    ranks = rankdata(draws, method="average").reshape(draws.shape)
    return ndtri((ranks - 3 / 8) / (draws.size + 1 / 4))


def _variances(draws: np.ndarray) -> tuple[float, float]:
    """Mean variance within chains, and the estimate of that of all."""
    count = draws.shape[1]
    within = float(draws.var(axis=1, ddof=1).mean())
    return within, within * (count - 1) / count + float(draws.mean(axis=1).var(ddof=1))


def _ratio(draws: np.ndarray) -> float:
    within, whole = _variances(draws)
    return float(np.sqrt(whole / within)) if within > 0 else np.nan


def _size(draws: np.ndarray) -> float:
    """From the autocorrelations, summed in pairs as long as they fall and are positive (Geyer)."""
    chains, count = draws.shape
    within, whole = _variances(draws)
    if not within > 0:
        return np.nan
    centred = draws - draws.mean(axis=1, keepdims=True)
    spectrum = np.fft.rfft(centred, n=2 * count)
    covariance = np.fft.irfft(np.abs(spectrum) ** 2)[:, :count].mean(axis=0) / count
    rho = 1 - (within - covariance * count / (count - 1)) / whole
    rho[0] = 1.0
    pairs = rho[: count // 2 * 2].reshape(-1, 2).sum(axis=1)
    positive = pairs[: np.argmax(pairs <= 0)] if (pairs <= 0).any() else pairs
    time = max(-1 + 2 * np.minimum.accumulate(positive).sum(), 1 / np.log10(chains * count))
    return float(chains * count / time)
