"""Another muscle of the same series: the same braid, bladder and end-fittings, cut to a length."""

import dataclasses

from .._types import Real, as_real
from . import AbstractMuscle, Muscle


def cut_to_length(muscle: AbstractMuscle, rest_length: Real) -> Muscle:
    """The muscle with another rest length, everything else of its construction being the same.

    The braid keeps its diameter and angle at rest, so that B0 and N are proportional to L0; bladder
    section, rubber and deadband stay. Rounded ends keep their dead length l = L0 (1 - 1/k), as the
    end-fittings do not know how long the muscle is.

    Args:
        muscle: of a geometry that can be cut: an estimated one, with or without an end effect, or one
            of your own with a method `cut_to_length`.
        rest_length: L0 [m] of the other muscle, > 0, above the dead length.

    Returns:
        The other muscle. Differentiable in its length.

    Raises:
        ValueError: the shape was measured or assumed over the length, and cannot be cut.

    >>> from famjax import Bladder, Braid, EstimatedGeometry, PolynomialMaterial
    >>> braid = Braid.from_rest(diameter=0.01, braid_angle=1.1, length=0.3)
    >>> long = Muscle(EstimatedGeometry(braid, Bladder(0.3, 0.009, 0.001)), PolynomialMaterial([1e6]))
    >>> short = cut_to_length(long, 0.1)
    >>> print(f"{short.blocked_force(5e5) / long.blocked_force(5e5):.6f}")
    1.000000
    """
    if not isinstance(muscle, Muscle):
        raise ValueError(
            f"only a famjax.Muscle can be cut to another length, got {type(muscle).__name__}: cut "
            "the muscle that it is made of"
        )
    geometry = muscle.geometry.cut_to_length(as_real(rest_length))
    return dataclasses.replace(muscle, geometry=geometry)
