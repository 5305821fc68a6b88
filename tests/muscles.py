"""Braids, laws, geometries, terms and muscles that many tests share."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import famjax
from famjax import braids, geometries, materials, peers, terms
from famjax.measured import AverageDiameterGeometry, MeasuredGeometry
from famjax.profiles import FourierProfile
from famjax.surfaces import MeasuredFamily

# ---- the reference work's 7/8 in specimen (Chambers 2021): in, psi, lbf

L0 = 9.28125
B0, N, AREA = 9.89, 1.09, 1.332e-4
SPECIMEN = famjax.Bladder(L0, 0.875, 0.0625)
INELASTIC = famjax.Braid(B0, N, 0.011)
TOE = braids.ToeThread(16.9e6, AREA, 0.002, 2.0)
KEVLAR = famjax.ElasticBraid(B0, N, 0.011, 144, braids.LinearThread(11.6e6, AREA))
CYLINDER = famjax.EstimatedGeometry(INELASTIC, SPECIMEN)
LATEX = famjax.PolynomialMaterial([257.8, -57.9, 32.7])
CHAMBERS = famjax.Muscle(CYLINDER, LATEX)
DESIGN = (0.875, 0.0625, 2.0, 0.011, 2.23, LATEX, 144.0, 59.3, L0)
"""Its braid and bladder as `famjax.design.Combination` takes them."""

TABLE_4_3 = {  # as corrected, 100 psi: by contraction, profile and length [in]
    contraction: (FourierProfile(*series), L0 * (1 - contraction))
    for contraction, *series in [  # contraction, a0, a_n, b_n, w
        (0.0, 1.02, [-0.09, -0.07, -0.01], [0.03, 0.06, 0.02], 5.596),
        (0.0875, 1.37, [-0.35, -0.15, -0.01], [-0.17, -0.19, -0.06], -5.371),
        (0.175, 1.51, [-0.56, -0.10, 0.04], [0.43, 0.41, 0.10], 4.961),
        (0.2625, 1.27, [-0.83, 0.29, 0.18], [1.20, 0.75, 0.04], 4.347),
        (0.35, -32.74, [24.82, 12.82, -3.90], [47.44, -18.47, -0.5], 2.176),
    ]
}


def measured_family(braid: braids.AbstractBraid) -> MeasuredFamily:
    """The family of table 4.3's profiles, made symmetric, about a braid."""
    profiles, lengths = zip(*TABLE_4_3.values(), strict=True)
    return MeasuredFamily(lengths, [one.symmetrised() for one in profiles], 100.0, braid)


def two_profiles(braid: braids.AbstractBraid) -> MeasuredFamily:
    """A family of as few numbers as one can have."""
    profiles = [
        FourierProfile(1.02, [-0.09, -0.07], [0.03, 0.06], 5.596).symmetrised(),
        FourierProfile(1.51, [-0.3, -0.1], [0.2, 0.1], 4.961).symmetrised(),
    ]
    return MeasuredFamily([L0, 0.75 * L0], profiles, 100.0, braid)


GEOMETRIES: dict[str, Callable[[], geometries.AbstractGeometry]] = {
    "estimated": lambda: CYLINDER,
    "embedded": lambda: famjax.EstimatedGeometry(
        INELASTIC, famjax.Bladder(L0, 1.0, 0.0625, embedded=True)
    ),
    "elastic": lambda: famjax.EstimatedGeometry(KEVLAR, SPECIMEN),
    "toe": lambda: famjax.EstimatedGeometry(dataclasses.replace(KEVLAR, thread=TOE), SPECIMEN),
    "compliant": lambda: famjax.EstimatedGeometry(
        braids.CompliantBraid.of(INELASTIC, 4e-6), SPECIMEN
    ),
    "measured": lambda: MeasuredGeometry(two_profiles(KEVLAR), SPECIMEN, 8),
    "average": lambda: AverageDiameterGeometry(two_profiles(INELASTIC), SPECIMEN, 8),
    "end effect": lambda: geometries.EndEffectGeometry(CYLINDER, 1.1),
}

TERMS: dict[str, terms.AbstractForceTerm] = {
    "pressurised braid": terms.PressurisedBraid(3.0),
    "virtual work": terms.VirtualWork(3.0),
    "virtual work at thread length": terms.VirtualWork(3.0, at_thread_length=True),
    "wall": terms.BladderWall(LATEX),
}

THREADS: dict[str, braids.AbstractThread] = {
    "linear": KEVLAR.thread,
    "toe": TOE,
    "sharp toe": braids.ToeThread(16.9e6, AREA, 0.01, 1e-3),
    "no toe": braids.ToeThread(16.9e6, AREA, 0.0, 2.0),
}

# ---- laws, of moduli about 1

OGDEN = ([0.63, 0.0012, -0.01], [1.3, 5.0, -2.0])  # Ogden 1972, MPa
HYPERELASTIC: dict[str, materials.AbstractHyperelastic] = {
    "neo-hookean": materials.NeoHookeanMaterial(0.8),
    "mooney-rivlin": materials.MooneyRivlinMaterial(0.3, 0.1),
    "yeoh": materials.YeohMaterial([0.4, -0.02, 0.003]),
    "ogden": materials.OgdenMaterial(*OGDEN),
}
LAWS: dict[str, materials.AbstractMaterial] = {
    **HYPERELASTIC,
    "saturating": materials.SaturatingMaterial(0.5, 0.3, 0.2),
    "polynomial": famjax.PolynomialMaterial([1.0, -0.3, 0.2]),
    "polynomial of pressure": materials.PressurePolynomialMaterial(
        [0.5, 1.0, 2.0], [[1.0, 0.2], [2.0, 0.1], [2.5, -0.3]]
    ),
    "plain powers": materials.PressurePolynomialMaterial(
        [0.5, 2.0], [[2.0, -1.0], [4.0, 0.5]], odd=False
    ),
}

# ---- in SI

FESTO_BRAID = famjax.Braid.from_rest(diameter=23e-3, braid_angle=np.deg2rad(62.0), length=0.296)
FESTO_CYLINDER = famjax.EstimatedGeometry(
    FESTO_BRAID, famjax.Bladder(0.296, 23e-3, 1.8e-3, embedded=True)
)
FESTO = famjax.Muscle(FESTO_CYLINDER, famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6]), 40e3)
"""Like the DMSP-20-300: braid inside the wall, stable cubic law, deadband."""
REST = 0.25
BRAID_10 = famjax.Braid.from_rest(diameter=0.012, braid_angle=1.12, length=REST)
CYLINDER_10 = famjax.EstimatedGeometry(BRAID_10, famjax.Bladder(REST, 0.012, 1.8e-3, embedded=True))
RUBBER = famjax.Muscle(CYLINDER_10, materials.NeoHookeanMaterial(3e5), 3e4)
TONDU = peers.TonduLopez(BRAID_10, REST, 1.2, 0.5, 2e4)

MUSCLES: dict[str, famjax.AbstractMuscle] = {
    "muscle": RUBBER,
    "virtual work": famjax.Muscle(
        CYLINDER_10, terms.VirtualWork(3e4) + terms.BladderWall(RUBBER.material)
    ),
    "mounted": famjax.MountedMuscle(RUBBER, 1e-5),
    "mounted by a power": famjax.MountedMuscle(RUBBER, 1.8e-5, 0.5),
    "gaylord": peers.Gaylord(BRAID_10, 3e4, -5.0, REST),
    "davis": peers.Gaylord(braids.CompliantBraid.of(BRAID_10, 2e-6), resting_length=REST),
    "tondu_lopez": TONDU,
    "ferraresi": famjax.Muscle(CYLINDER_10, famjax.PolynomialMaterial([2e6]), 3e4),
    "kothera": peers.Kothera(famjax.Muscle(CYLINDER_10, famjax.PolynomialMaterial([2e6]))),
    "robinson": famjax.Muscle(
        CYLINDER_10,
        materials.PressurePolynomialMaterial([1e5, 6e5], [[2e6, 0], [3e6, 1e6]], odd=False),
    ),
    "klute_hannaford": famjax.Muscle(CYLINDER_10, materials.MooneyRivlinMaterial(2e5, 1e5), 3e4),
    "sarosi": peers.Sarosi(REST, -9.22e-5, 203.7, -34.22, -3.226e-3, 1.092e-3, -208.4),
    "martens": peers.Martens.published("DMSP-10-250"),
    "hildebrandt": peers.Hildebrandt(REST, [1e-3, -4e-3, 3e-3], [-30.0, -500, 300, 10, -9]),
}


class Lever(famjax.control.AbstractPath):
    """A user's own path: a muscle between a pin on the link and a pin on the base, L = |R a - b| - l."""

    link_pin: jnp.ndarray = eqx.field(converter=jnp.asarray)
    base_pin: jnp.ndarray = eqx.field(converter=jnp.asarray)
    dead_length: float = 0.0

    def length(self, angle):
        x, y = self.link_pin
        cos, sin = jnp.cos(angle), jnp.sin(angle)
        across, along = cos * x - sin * y, sin * x + cos * y
        return jnp.hypot(across - self.base_pin[0], along - self.base_pin[1]) - self.dead_length
