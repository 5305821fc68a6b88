"""The exact figures of a scene, by closed forms that the renderer itself does not use."""

import numpy as np

from .truth import Truth
from .world import World

_POINTS = 1001


def true_figures(world: World) -> Truth:
    """What a perfect measurement of this world's picture would find."""
    from scipy.integrate import simpson  # noqa: PLC0415 - keeps the import cheap
    from scipy.interpolate import CubicSpline  # noqa: PLC0415

    muscle = world.muscle
    sides = [CubicSpline(v, u) for u, v in world.outline()]
    first = max(side.x[0] for side in sides)
    last = min(side.x[-1] for side in sides)
    rows = np.arange(np.ceil(first), np.floor(last) + 1)
    z = np.linspace(0, muscle.length, _POINTS)
    D = muscle.diameter(z / muscle.length)
    lower = world.axis.first + muscle.length
    return Truth(
        rows=rows,
        left=sides[0](rows),
        right=sides[1](rows),
        z=z,
        diameter=D,
        length=muscle.length,
        volume=float(simpson(np.pi / 4 * D**2, x=z)),
        mean_diameter=float(simpson(D, x=z)) / muscle.length,
        maximum_diameter=float(D.max()),
        px_per_m=world.camera.px_per_m,
        x0=muscle.x0,
        roll=muscle.roll,
        y0=muscle.y0,
        upper_edge=world.ring(world.axis.first, world.edge_radius(muscle.upper, 0)),
        lower_edge=world.ring(lower, world.edge_radius(muscle.lower, -1)),
    )
