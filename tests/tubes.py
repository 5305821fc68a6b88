"""Force of a muscle by virtual work on its whole energy: a physics written apart from famjax.

With the length x of the cylinder, the threads' length b and the active length L(x, b):

    E(x, b) = U(x, b) - P V(x, b) + k (b - b0)^2 / 2,    dE/dx = F dL/dx,    dE/db = F dL/db
"""

import dataclasses
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

Law = Literal["mooney-rivlin", "ogden", "gent", "yeoh"]
Ends = Literal["none", "cones", "domes"]
Branch = Literal["mean", "shortening", "lengthening"]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_STEP = 1e-30
_ROUNDS, _SETTLED = 60, 1e-8  # of the iteration for stretched threads and a rig that gives way
FITS_WITHIN = 1.5
"""RMSE [N] of `alike_tube` on the loaded readings."""
_NO_MUSCLE, _FAR_OFF = 1e4, 8.0  # N: where there is no equilibrium; RMSE after the first steps


@dataclasses.dataclass(frozen=True)
class Rubber:
    """A strain energy in the principal stretches."""

    law: Law
    modulus: float  # initial shear modulus
    shape: tuple[float, ...]
    plateau: float = 0.0  # stress that filled rubber adds from small strains on (Payne effect)
    knee: float = 0.1  # sqrt(I1 - 3) at which it is reached

    def energy(self, around: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Per volume [J/m3], at stretches around and along; the third follows from the volume."""
        stretches = np.stack(np.broadcast_arrays(around, along, 1 / (around * along)))
        first = np.sum(stretches**2, 0) - 3
        filled = self.plateau * self.knee * (np.sqrt(1 + first / self.knee**2) - 1)
        return filled + self._law(stretches, first)

    def _law(self, stretches: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Of the law alone, of the principal stretches, shape (3, ...), and I1 - 3."""
        if self.law == "ogden":
            power_1, power_2, part = self.shape
            one, two = (np.sum(stretches**power, 0) - 3 for power in (power_1, power_2))
            return 2 * self.modulus * ((1 - part) / power_1**2 * one + part / power_2**2 * two)
        if self.law == "mooney-rivlin":
            (part,) = self.shape
            return self.modulus / 2 * ((1 - part) * first + part * (np.sum(stretches**-2, 0) - 3))
        if self.law == "gent":
            (limit,) = self.shape
            return -self.modulus * limit / 2 * np.log(1 - first / limit)
        second, third = self.shape
        return self.modulus / 2 * first * (1 + first * (second + third * first))


def drawn_rubber(random: np.random.Generator, modulus: float) -> Rubber:
    """A rubber of one of the laws, of that initial shear modulus [Pa]; one in three is filled."""
    law = ("mooney-rivlin", "ogden", "gent", "yeoh")[int(random.integers(4))]
    shape = {
        "mooney-rivlin": (random.uniform(0.0, 0.4),),
        "ogden": (random.uniform(1.3, 4.0), -random.uniform(1.0, 5.0), random.uniform(0.0, 0.6)),
        "gent": (random.uniform(4.0, 30.0),),
        "yeoh": (-random.uniform(0.0, 0.08), random.uniform(0.002, 0.02)),
    }[law]
    rubber = Rubber(law, modulus, tuple(map(float, shape)))
    if random.random() < 0.7:
        return rubber
    plateau, knee = float(random.uniform(0.05, 0.3)) * modulus, float(random.uniform(0.1, 0.4))
    return dataclasses.replace(rubber, plateau=plateau, knee=knee)


@dataclasses.dataclass(frozen=True)
class Tube:
    """A muscle in its test rig; SI."""

    rest_length: float
    bore: float
    wall: float
    depth: float  # of the braid below the outer surface, in parts of the wall
    angle: float  # of the threads from the circumference at rest
    rubber: Rubber
    thread_stretch: float = 0.0  # strain of the threads for each newton of their common tension
    ends: Ends = "none"  # "cones" open with threads of one length, "domes" hold less
    end_size: float = (
        0.0  # of a cone over the braid's radius, of both domes over the radius that opens
    )
    deadband: float = 0.0  # spent before the muscle is filled, at pressures well above it
    rig_give: float = 0.0  # by which the rig gives way [m/N]
    rig_play: float = 0.0  # by which joints give way before they are taut
    taut: float = 1.0  # force at which 63 % of it is taken up
    gain: float = 1.0  # of the load cell
    offset: float = 0.0  # of the pressure in the muscle over what is read
    friction: float = 0.0  # in parts of what the pressure pushes on the braid's section
    branch: Branch = "mean"  # both, or which was recorded

    @property
    def braid_radius(self) -> float:
        """At rest [m]."""
        return self.bore / 2 + self.wall * (1 - self.depth)

    @property
    def cone(self) -> float:
        """Length of one cone's threads along the meridian [m]."""
        return self.end_size * self.braid_radius if self.ends == "cones" else 0.0

    @property
    def cylinder(self) -> float:
        """Length of the cylinder at rest [m]."""
        return self.rest_length - 2 * self.cone

    @property
    def thread(self) -> float:
        """Length b0 of a thread in the cylinder [m]."""
        return self.cylinder / np.sin(self.angle)

    def radius(self, x: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Of the braid [m], with a cylinder of length x and threads of length b."""
        return self.braid_radius * np.sqrt((b**2 - x**2) / (self.thread**2 - self.cylinder**2))

    def length(self, x: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Active length [m]."""
        opened = self.radius(x, b) - self.braid_radius
        return x + 2 * np.sqrt(self.cone**2 - opened**2) if self.cone else x + 0 * b

    def energy(self, x: np.ndarray, b: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Of rubber and fluid [J], less that of the threads."""
        r, rest, along = self.radius(x, b), self.braid_radius, x / self.cylinder
        R = self.bore / 2 + self.wall * (_NODES + 1) / 2
        around = np.sqrt(r[..., None] ** 2 + (R**2 - rest**2) / along[..., None]) / R
        density = self.rubber.energy(around, along[..., None])
        wall = 2 * np.pi * self.cylinder * (density * R) @ (_WEIGHTS * self.wall / 2)
        fluid = np.pi * r**2 * x
        if self.cone:
            height = np.sqrt(self.cone**2 - (r - rest) ** 2)
            fluid = fluid + 2 * np.pi / 3 * height * (r**2 + r * rest + rest**2)
        elif self.ends == "domes":
            fluid = fluid - np.pi / 3 * self.end_size * (r - rest) ** 2 * (2 * r + rest)
        return wall - pressure * fluid

    @np.errstate(divide="ignore", over="ignore", invalid="ignore")
    def reading(self, length: ArrayLike, pressure: ArrayLike) -> np.ndarray:
        """What the load cell shows without noise [N], broadcast; 0 where the muscle is slack.

        nan where there is no equilibrium: threads that are straight, rubber at its limit. Length and
        gauge pressure are as the rig reads them.
        """
        L, P = np.broadcast_arrays(np.asarray(length, float), np.asarray(pressure, float))
        acting = P + self.offset
        if self.deadband:
            acting = acting - self.deadband * -np.expm1(-acting / self.deadband)
        x, b = L - 2 * self.cone, np.full(L.shape, self.thread)
        force, moved = np.zeros(L.shape), np.full(L.shape, np.inf)
        for _ in range(_ROUNDS):
            pull = np.maximum(force, 0.0)
            given = self.rig_give * pull - self.rig_play * np.expm1(-pull / self.taut)
            length_x, length_b = _slopes(self.length, x, b)
            x = x - (self.length(x, b) - (L - given)) / length_x
            energy_x, energy_b = _slopes(lambda x, b: self.energy(x, b, acting), x, b)
            length_x, length_b = _slopes(self.length, x, b)
            before, force = force, energy_x / length_x
            tension = np.maximum(force * length_b - energy_b, 0.0)
            b = self.thread * (1 + self.thread_stretch * tension)
            moved = np.abs(force - before) / (1 + np.abs(force))
            if np.all(moved <= _SETTLED):
                break
        sign = {"mean": 0.0, "shortening": -1.0, "lengthening": 1.0}[self.branch]
        force = force + sign * self.friction * acting * np.pi * self.radius(x, b) ** 2
        return np.where(moved <= _SETTLED, np.maximum(self.gain * force, 0.0), np.nan)


def _slopes(function: Any, x: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    along = np.imag(function(x + 1j * _STEP, b + 0j)) / _STEP
    return along, np.imag(function(x + 0j, b + 1j * _STEP)) / _STEP


def alike_tube(length: Any, pressure: Any, force: np.ndarray, seed: int) -> tuple[Tube, float]:
    """A muscle that fits loaded readings within `FITS_WITHIN`, drawn anew until it does; its RMSE [N]."""
    random = np.random.default_rng((seed, 2))
    while True:
        tube, unknowns = _drawn(random, float(length.max()))

        def of(numbers: np.ndarray, tube: Tube = tube, unknowns: Any = tuple(unknowns)) -> Tube:
            for (_, _, name), number in zip(unknowns, numbers, strict=True):
                tube = _changed(tube, name, float(number))
            return tube

        def residuals(numbers: np.ndarray, of: Any = of) -> np.ndarray:
            return np.nan_to_num(of(numbers).reading(length, pressure), nan=_NO_MUSCLE) - force

        low, high = (np.array([one[end] for one in unknowns]) for end in (0, 1))
        at = low + random.uniform(0.1, 0.6, low.size) * (high - low)
        for tries, worst in ((8, _FAR_OFF), (25, FITS_WITHIN)):
            how = {"bounds": (low, high), "x_scale": high - low, "diff_step": 1e-5}
            found = least_squares(residuals, at, max_nfev=tries, **how)
            at, rmse = found.x, float(np.sqrt(np.mean(found.fun**2)))
            if rmse > worst:
                break
        else:
            return of(at), rmse


def _changed(tube: Tube, name: str, value: float) -> Tube:
    """The muscle with another modulus [MPa], angle [deg], number of its law, or field."""
    rubber = tube.rubber
    if name == "modulus":
        return dataclasses.replace(tube, rubber=dataclasses.replace(rubber, modulus=1e6 * value))
    if name.isdigit():
        shape = tuple(value if k == int(name) else one for k, one in enumerate(rubber.shape))
        return dataclasses.replace(tube, rubber=dataclasses.replace(rubber, shape=shape))
    return dataclasses.replace(tube, **{name: np.deg2rad(value) if name == "angle" else value})


def _drawn(random: np.random.Generator, rest: float) -> tuple[Tube, list[tuple[float, float, str]]]:
    """A muscle of 10 mm bore in its rig, and what of it is fitted: bounds and name."""
    law = dataclasses.replace(
        drawn_rubber(random, 1e6), plateau=float(random.uniform(0, 1e6)),
        knee=float(np.exp(random.uniform(np.log(0.03), np.log(0.4)))),
    )  # fmt: skip
    ends = ("none", "cones", "domes")[int(random.integers(3))]
    tube = Tube(
        rest, 0.010, 1.8e-3, float(random.uniform(0.1, 0.9)), np.deg2rad(64.0), law, ends=ends,
        end_size=float(random.uniform(1.2, 4.0) if ends == "cones" else random.uniform(0.5, 3.0)),
    )  # fmt: skip
    ranges = {
        "mooney-rivlin": ((0.0, 1.0),),
        "ogden": ((1.0, 6.0), (-10.0, -0.5), (0.0, 1.0)),
        "gent": ((1.0, 30.0),),
        "yeoh": ((-0.3, 0.5), (0.0, 0.3)),
    }[law.law]
    unknowns = [(0.1, 4.0, "modulus"), (60.0, 70.0, "angle"), (0.0, 6e4, "deadband")]
    unknowns.append((0.0, 2e-5, "thread_stretch"))
    unknowns += [(low, high, str(k)) for k, (low, high) in enumerate(ranges)]
    if random.random() < 0.6:
        unknowns += [(0.0, 5e-6, "rig_give"), (0.0, 2e-3, "rig_play")]
        tube = dataclasses.replace(tube, taut=float(random.uniform(20, 100)))
    if ends != "none":
        low, high = (1.0, 5.0) if ends == "cones" else (0.0, 4.0)
        unknowns.append((low, high, "end_size"))
    return tube, unknowns
