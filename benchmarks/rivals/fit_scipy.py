"""What a user writes by hand for the fit of `famjax fit`: NumPy and SciPy, no certificate.

    python benchmarks/rivals/fit_scipy.py fitting/data/dmsp-20-300.csv

Braid diameter, braid angle and deadband by bounded least squares from several starts, the three
coefficients of the bladder by linear least squares inside. It imports nothing of this project.
"""

import sys

import numpy as np
from scipy.optimize import least_squares

REST_LENGTH, WALL, STARTS = 0.296, 1.8e-3, 16
LOW = np.array([20e-3, np.deg2rad(60), 0.0])
HIGH = np.array([23.6e-3, np.deg2rad(70), 100e3])


def load(path):
    """Pressure [Pa], length [m] and force [N] of the readings that pull."""
    with open(path) as file:
        rows = [line.split(",") for line in file if line[0].isdigit()]
    pressure, length, force = np.array(rows, float).T
    return pressure[force > 0], length[force > 0], force[force > 0]


def parts(geometry, pressure, length):
    """The braid's force and the columns of E_1, E_2, E_3; threads inside the rubber."""
    diameter, angle, deadband = geometry
    thread = REST_LENGTH / np.sin(angle)
    turns = thread * np.cos(angle) / (np.pi * diameter)
    radius = np.sqrt(thread**2 - length**2) / (2 * np.pi * turns)
    braid = (pressure - deadband) * (3 * length**2 - thread**2) / (4 * np.pi * turns**2)
    volume = np.pi * diameter * WALL * REST_LENGTH
    wall = volume / (2 * np.pi * radius * length)
    axial, hoop = length / REST_LENGTH - 1, 2 * radius / diameter - 1
    columns = [
        np.sign(axial) * abs(axial) ** n * volume / length
        - np.sign(hoop) * abs(hoop) ** n * wall * length**2 / (2 * np.pi * radius * turns**2)
        for n in (1, 2, 3)
    ]
    return braid, np.stack(columns, axis=1)


def residual(unit, pressure, length, force):
    """Model minus measured force with the best coefficients for this geometry [N]."""
    braid, columns = parts(LOW + unit * (HIGH - LOW), pressure, length)
    size = np.linalg.norm(columns, axis=0)
    best = np.linalg.lstsq(columns / size, force - braid, rcond=None)[0]
    return braid + columns / size @ best - force


def main():
    """Fit the map and print the optimum."""
    data = load(sys.argv[1])
    starts = np.random.default_rng(0).uniform(size=(STARTS, 3))
    fits = [least_squares(residual, start, bounds=(0, 1), args=data) for start in starts]
    best = min(fits, key=lambda fit: fit.cost)
    diameter, angle, deadband = LOW + best.x * (HIGH - LOW)
    print(f"rmse_N {np.sqrt(np.mean(best.fun**2)):.6f}")
    print(f"D0 {diameter * 1e3:.4f} mm, angle {np.rad2deg(angle):.4f} deg, P_d {deadband:.0f} Pa")


if __name__ == "__main__":
    main()
