"""Force maps of muscles that are known, with noise."""

from collections.abc import Sequence

import numpy as np

import famjax
from fitting import ForceData, Specimen

REST = 0.25  # m


def muscle_map(
    *,
    noise: float,
    seed: int,
    lengths: Sequence[float] = (1.0, 0.96, 0.92, 0.88, 0.84, 0.8),
    pressures: Sequence[float] = (1e5, 2e5, 3e5, 4e5, 5e5, 6e5),
    deadband: float = 2e4,
    rig: tuple[float, float | None] | None = None,
    rest: float = REST,
) -> ForceData:
    """A Mooney-Rivlin muscle of 12 mm bore, braided at 64 deg.

    Args:
        noise: standard deviation of a reading [N].
        seed: of the noise.
        lengths: in parts of the rest length.
        pressures: gauge [Pa].
        deadband: [Pa].
        rig: compliance [m/N] and exponent of one that gives way.
        rest: rest length [m] of this one of its make.
    """
    diameter, wall = 0.0135, 1.5e-3
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=np.radians(64), length=rest)
    bladder = famjax.Bladder(rest, diameter, wall, embedded=True)
    muscle = famjax.Muscle(
        famjax.EstimatedGeometry(braid, bladder),
        famjax.materials.MooneyRivlinMaterial(0.4e6, 0.15e6),
        deadband_pressure=deadband,
    )
    L, P = (grid.ravel() for grid in np.meshgrid(rest * np.array(lengths), pressures))
    measured = muscle if rig is None else famjax.MountedMuscle(muscle, *rig)
    force = np.asarray(measured.force(L, P)) + np.random.default_rng(seed).normal(0, noise, L.size)
    return ForceData(
        force=np.maximum(force, 0.0), pressure=P, length=L,
        specimen=Specimen(rest_length=rest, wall_thickness=wall, nominal_diameter=0.012,
                          embedded=True, name="synthetic"),
    )  # fmt: skip
