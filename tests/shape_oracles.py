"""The equilibrium shape by two ways that share nothing with the library: boundary values, quadrature."""

import dataclasses

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_U, _W = (_NODES + 1) / 2, _WEIGHTS / 2


@dataclasses.dataclass(frozen=True)
class Specimen:
    """A uniform muscle with an odd polynomial law, both fittings alike; any consistent units."""

    B: float = 9.89
    N: float = 1.09
    braid: float = 0.011
    L0: float = 9.28125
    D0: float = 0.875
    t0: float = 0.0625
    end: float = 0.863
    E: tuple[float, ...] = (257.8, -57.9, 32.7)

    @property
    def rubber(self) -> float:
        return np.pi * (self.D0 - self.t0) * self.t0 * self.L0

    def lam(self, r: np.ndarray) -> np.ndarray:
        return np.sqrt(self.B**2 - (2 * np.pi * self.N * r) ** 2)

    def sigma(self, e: np.ndarray) -> np.ndarray:
        return sum(E * np.sign(e) * np.abs(e) ** (n + 1) for n, E in enumerate(self.E))

    def strains(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lam, R = self.lam(r), r - self.braid
        middle = (R + np.sqrt(R**2 - self.rubber / (np.pi * lam))) / 2
        return lam / self.L0 - 1, middle / ((self.D0 - self.t0) / 2) - 1

    def w(self, r: np.ndarray) -> np.ndarray:
        """Strain energy per Z."""
        total = 0.0
        for e in self.strains(r):
            at = e[..., None] * _U
            total = total + self.rubber * e * ((self.sigma(at) / (1 + at)) @ _W)
        return total

    def dw(self, r: np.ndarray) -> np.ndarray:
        lam, R = self.lam(r), r - self.braid
        dlam = -((2 * np.pi * self.N) ** 2) * r / lam
        root = np.sqrt(R**2 - self.rubber / (np.pi * lam))
        droot = (2 * R + self.rubber * dlam / (np.pi * lam**2)) / (2 * root)
        rates = dlam / self.L0, (1 + droot) / (self.D0 - self.t0)
        return sum(
            self.rubber * self.sigma(e) / (1 + e) * rate
            for e, rate in zip(self.strains(r), rates, strict=True)
        )

    def cylinder_pull(self, r: np.ndarray, P: float) -> np.ndarray:
        lam = self.lam(r)
        dlam = -((2 * np.pi * self.N) ** 2) * r / lam
        return (self.dw(r) - 2 * np.pi * P * r * lam) / dlam - P * np.pi * r**2


def boundary_values(one: Specimen, L: float, P: float, r: np.ndarray, F: float) -> tuple:
    """Pull and the shape (Z, r, z) of half a muscle, by the Hamiltonian form and `solve_bvp`.

    From guesses of the radius r at equal steps of Z from 0 to 1/2, and of the pull F.
    """

    def rates(_: np.ndarray, y: np.ndarray, k: np.ndarray) -> np.ndarray:
        r, _, p = y
        m, lam = P * np.pi * r**2 + k[0], one.lam(r)
        root = np.hypot(m, p)
        dlam = -((2 * np.pi * one.N) ** 2) * r / lam
        z = lam * m / root
        return np.stack([lam * p / root, z, one.dw(r) - 2 * np.pi * P * r * z - dlam * root])

    def ends(a: np.ndarray, b: np.ndarray, _: np.ndarray) -> np.ndarray:
        return np.array([a[0] - one.end / 2, a[1], b[2], b[1] - L / 2])

    Z = np.linspace(0, 0.5, r.size)
    slope, lam = np.gradient(r, Z), one.lam(r)
    slope = np.clip(slope, -0.95 * lam, 0.95 * lam)
    p = (P * np.pi * r**2 + F) * slope / np.sqrt(lam**2 - slope**2)
    start = np.stack([r, np.linspace(0, L / 2, r.size), p])
    found = solve_bvp(rates, ends, Z, start, np.array([F]), tol=1e-8, max_nodes=20000)
    assert found.success, found.message
    return found.p[0], found.sol


def long_muscle(one: Specimen, L: float, P: float) -> float:
    """Pull of a long muscle, of which the middle is a cylinder, by quadrature."""

    def length(rc: float) -> float:
        F, lam, re = float(one.cylinder_pull(np.array(rc), P)), one.lam(rc), one.end / 2
        C = (P * np.pi * rc**2 + F) * lam - one.w(np.array(rc))
        r = rc - (rc - re) * _U
        rise = (P * np.pi * r**2 + F) * one.lam(r) ** 2 / (C + one.w(r))
        slope = np.sqrt((one.lam(r) - rise) * (one.lam(r) + rise))
        return float(lam + 2 * np.sum((rise - lam) / slope * (rc - re) * _W))

    # The cylinder that is as long is a little too narrow; narrow ones are no saddles.
    narrow = one.B * np.sqrt(1 - (L / one.B) ** 2) / (2 * np.pi * one.N)
    radii = narrow * np.linspace(1.0, 1.4, 400)
    with np.errstate(invalid="ignore", divide="ignore"):
        after = next(i for i, r in enumerate(radii) if length(r) < L)
    rc = brentq(lambda r: length(r) - L, radii[after - 1], radii[after], xtol=1e-14)
    return float(one.cylinder_pull(np.array(rc), P))
