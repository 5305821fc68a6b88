"""What a user of lmfit writes for the fit of `famjax fit`: all six parameters together.

    python benchmarks/rivals/fit_lmfit.py fitting/data/dmsp-20-300.csv

Bounded parameters, several starts, derivatives by differences, no certificate. The force is that of
`fit_scipy.py`, which stands beside it; it imports nothing of this project.
"""

import sys

import lmfit
import numpy as np
from fit_scipy import HIGH, LOW, STARTS, load, parts

NAMES = ("diameter", "angle", "deadband")


def residual(parameters, pressure, length, force):
    """Model minus measured force [N]; coefficients in MPa."""
    v = parameters.valuesdict()
    geometry = LOW + np.array([v[name] for name in NAMES]) * (HIGH - LOW)
    braid, columns = parts(geometry, pressure, length)
    return braid + 1e6 * columns @ [v["E_1"], v["E_2"], v["E_3"]] - force


def main():
    """Fit the map and print the optimum."""
    data, rng, fits = load(sys.argv[1]), np.random.default_rng(0), []
    for _ in range(STARTS):
        parameters = lmfit.Parameters()
        for name in NAMES:
            parameters.add(name, value=rng.uniform(), min=0, max=1)
        for n in (1, 2, 3):
            parameters.add(f"E_{n}", value=rng.normal())
        fits.append(lmfit.minimize(residual, parameters, args=data, xtol=1e-12, ftol=1e-12))
    best = min(fits, key=lambda fit: fit.chisqr)
    v = best.params.valuesdict()
    diameter, angle, deadband = LOW + np.array([v[name] for name in NAMES]) * (HIGH - LOW)
    print(f"rmse_N {np.sqrt(np.mean(best.residual**2)):.6f}")
    print(f"D0 {diameter * 1e3:.4f} mm, angle {np.rad2deg(angle):.4f} deg, P_d {deadband:.0f} Pa")


if __name__ == "__main__":
    main()
