"""Force maps of muscles that nobody ever built: random, plausible, with and without noise."""

import math

import numpy as np
from jaxtyping import Float

import famjax
from fitting import ForceData, Specimen

_LAWS = ("linear", "cubic", "mooney-rivlin", "ogden")


def random_map(seed: int) -> ForceData:
    """The map of a random muscle.

    Bores of 8 to 40 mm, walls of 5 to 12 % of them, braid angles of 62 to 69 deg, rubbers of 0.6 to
    3 MPa, rounded ends, rigs that give; 3 to 10 lengths at 0 to 25 % of contraction, 4 to 10
    pressures up to 4 to 8 bar. Two maps of three have noise: 0.2 to 1 % of the largest force, 0.1 %
    of the rest length on each length, 0.5 kPa on each pressure. Slack readings are zeros.

    Args:
        seed: of everything.
    """
    random = np.random.default_rng(seed)
    bore = random.uniform(8e-3, 40e-3)
    wall = min(bore * random.uniform(0.05, 0.12), 1.8e-3)
    embedded = bool(random.random() < 0.5)
    outer = bore + 2 * wall
    diameter = bore + wall * random.uniform(0.6, 1.4) if embedded else outer
    rest = round(bore * random.uniform(9, 22), 3)
    braid = famjax.Braid.from_rest(
        diameter=diameter, braid_angle=math.radians(random.uniform(62, 69)), length=rest
    )
    bladder = famjax.Bladder(rest, diameter if embedded else outer, wall, embedded=embedded)
    cylinder = famjax.EstimatedGeometry(braid, bladder)
    geometry = famjax.geometries.EndEffectGeometry(cylinder, random.uniform(1.0, 1.2))
    law = _LAWS[int(random.integers(len(_LAWS)))]
    muscle = famjax.Muscle(geometry, _material(law, random), random.uniform(5e3, 50e3))
    model = famjax.MountedMuscle(muscle, 1e-3 * rest / _strength(muscle))
    highest = random.uniform(4e5, 8e5)
    lengths = rest * (1 - np.linspace(0, random.uniform(0.12, 0.25), int(random.integers(3, 11))))
    pressures = np.linspace(random.uniform(0.1, 0.25), 1, int(random.integers(4, 11))) * highest
    L, P = (grid.ravel() for grid in np.meshgrid(np.round(lengths, 4), np.round(pressures, -2)))
    noisy = random.random() < 2 / 3
    moved = 1e-3 * rest * noisy * random.normal(size=lengths.size).clip(-2, 2)
    moved -= moved.max()  # none is longer than the rest length
    true_length = L + np.tile(moved, pressures.size)
    force = np.asarray(model.force(true_length, P + 500 * noisy * random.normal(size=P.size)))
    force = np.nan_to_num(force, nan=0.0)
    slack = force <= 0
    force = np.where(slack, 0.0, force)
    noise = random.uniform(0.002, 0.01) * force.max() * noisy
    force = force + noise * random.normal(size=force.size) * ~slack
    specimen = Specimen(
        f"random {seed}", rest, wall, nominal_diameter=bore, embedded=embedded,
        bladder_diameter=None if embedded else outer,
    )  # fmt: skip
    return ForceData(force, P, L, specimen, source=f"random muscle {seed}")


def _strength(muscle: famjax.Muscle) -> Float[np.ndarray, ""]:
    """Blocked force [N] at 6 bar."""
    return np.asarray(muscle.blocked_force(6e5))


def _material(law: str, random: np.random.Generator) -> famjax.materials.AbstractMaterial:
    E = random.uniform(0.6e6, 3e6)
    if law == "linear":
        return famjax.PolynomialMaterial(np.array([E]))
    if law == "cubic":
        return famjax.PolynomialMaterial(E * np.array([1.0, -1.2, 1.2]))
    if law == "mooney-rivlin":
        share = random.uniform(0.6, 0.95)
        return famjax.materials.MooneyRivlinMaterial(E / 6 * share, E / 6 * (1 - share))
    exponent = random.uniform(1.5, 4.0)
    return famjax.materials.OgdenMaterial(np.array([2 * E / 3 / exponent]), np.array([exponent]))
