"""The runs test: whether residuals change their sign as often as noise does."""

import numpy as np
from jaxtyping import Float


def runs_deviation(residuals: Float[np.ndarray, " n"]) -> float:
    """By how many standard deviations there are more runs of one sign than chance gives.

    With n1 positive and n2 negative residuals in random order the number of runs has the mean
    1 + 2 n1 n2 / n and the variance (mean - 1)(mean - 2)/(n - 1).

    Args:
        residuals: in the order in which neighbours would be alike, shape (n,); zeros are left out.

    Returns:
        Below zero where there are fewer; 0 with fewer than 10 residuals. All of one sign have a
        single run, and their deviation is -inf.

    References:
        Wald & Wolfowitz 1940.

    >>> print(f"{runs_deviation(np.array([1.0, -1.0] * 8)):.2f}")
    3.62
    >>> print(f"{runs_deviation(np.array([1.0] * 8 + [-1.0] * 8)):.2f}")
    -3.62
    """
    signs = np.sign(residuals[residuals != 0])
    if signs.size < 10:
        return 0.0
    n, positive = signs.size, int((signs > 0).sum())
    mean = 1 + 2 * positive * (n - positive) / n
    variance = (mean - 1) * (mean - 2) / (n - 1)
    runs = 1 + int((np.diff(signs) != 0).sum())
    return float((runs - mean) / np.sqrt(variance)) if variance > 0 else -np.inf
