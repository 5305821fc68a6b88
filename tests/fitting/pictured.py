"""Pictures of a muscle of known shape: the reference work's profiles, at random states."""

import numpy as np

import famjax
from fitting.shapes import Pictures

INCH, PSI = 0.0254, 6894.757293168361
REST = 9.28125 * INCH
BRAID = famjax.Braid(9.89 * INCH, 1.09, 0.011 * INCH)
STRETCH = 2e-4  # of the diameter per psi, about the middle of the pressures
_ROWS = [  # Chambers 2021, table 4.3 as corrected: contraction, a0, a_n, b_n, w
    (0.0, 1.02, [-0.09, -0.07, -0.01], [0.03, 0.06, 0.02], 5.596),
    (0.0875, 1.37, [-0.35, -0.15, -0.01], [-0.17, -0.19, -0.06], -5.371),
    (0.175, 1.51, [-0.56, -0.10, 0.04], [0.43, 0.41, 0.10], 4.961),
    (0.2625, 1.27, [-0.83, 0.29, 0.18], [1.20, 0.75, 0.04], 4.347),
    (0.35, -32.74, [24.82, 12.82, -3.90], [47.44, -18.47, -0.5], 2.176),
]


def true_family() -> famjax.surfaces.MeasuredFamily:
    lengths = [REST * (1 - row[0]) for row in _ROWS]
    profiles = [
        famjax.profiles.FourierProfile(
            a0 * INCH, np.array(a) * INCH, np.array(b) * INCH, w
        ).symmetrised()
        for _, a0, a, b, w in _ROWS
    ]
    return famjax.surfaces.MeasuredFamily(lengths, profiles, 55 * PSI, BRAID)


def true_diameter(
    x: np.ndarray, length: np.ndarray, pressure: np.ndarray, stretch: float
) -> np.ndarray:
    """D [m], shape (states, positions)."""
    shape = np.array(true_family().diameter(x, length[:, None], 55 * PSI))
    return shape * (1 + stretch * (pressure[:, None] / PSI - 55))


def photographed(
    n: int = 120, noise: float = 0.0, seed: int = 0, *, stretch: float = 0.0, scale: float = 0.0
) -> Pictures:
    """n pictures; noise [m] of the diameters, correlated over a fiftieth of the length."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 1, 201)
    length = REST * (1 - 0.35 * rng.uniform(size=n))
    pressure = rng.choice(np.arange(10, 101, 10), n) * PSI
    along = np.exp(-0.5 * ((x[:, None] - x) / 0.02) ** 2) + 1e-9 * np.eye(x.size)
    wrong = noise * rng.standard_normal((n, x.size)) @ np.linalg.cholesky(along).T
    factor = 1 + scale * rng.standard_normal()
    diameter = (true_diameter(x, length, pressure, stretch) + wrong) * factor
    names = tuple(f"DSC_{k:04d}.JPG" for k in range(n))
    return Pictures(names, length * factor, diameter, pressure, scale, source="pictures")
