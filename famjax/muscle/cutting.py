"""Another muscle of the same series: the same braid, bladder and end-fittings, cut to a length."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from .._types import Real, RealArray, as_real
from ..geometries.dimensions import AbstractGeometry
from ..geometries.end_effect import EndEffectGeometry
from ..geometries.estimated import EstimatedGeometry
from . import AbstractMuscle, Muscle


def cut_to_length(muscle: AbstractMuscle, rest_length: Real) -> Muscle:
    """The muscle with another rest length, everything else of its construction being the same.

    The braid keeps its diameter and angle at rest, so that B0 and N are proportional to L0; bladder
    section, rubber and deadband stay. Rounded ends keep their dead length l = L0 (1 - 1/k), as the
    end-fittings do not know how long the muscle is.

    Args:
        muscle: of an estimated geometry, with or without an end effect.
        rest_length: L0 [m] of the other muscle, > 0, above the dead length.

    Returns:
        The other muscle. Differentiable in its length.

    Raises:
        ValueError: the shape was measured or assumed over the length, and cannot be cut.

    >>> from famjax import Bladder, Braid, PolynomialMaterial
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
    new = as_real(rest_length)
    return dataclasses.replace(muscle, geometry=_cut(muscle.geometry, new))


def _cut(geometry: AbstractGeometry, new: RealArray) -> AbstractGeometry:
    if isinstance(geometry, EndEffectGeometry):
        old = geometry.rest_length
        dead = old * (1 - 1 / geometry.end_factor)
        new = eqx.error_if(
            new, jnp.any(new <= dead), "the rest length must be above the dead length of the ends"
        )
        return EndEffectGeometry(_cut(geometry.cylinder, new), new / (new - dead))
    if isinstance(geometry, EstimatedGeometry):
        braid, bladder = geometry.braid, geometry.bladder
        new = eqx.error_if(new, jnp.any(new <= 0), "the rest length must be above 0")
        ratio = new / bladder.rest_length
        longer = eqx.tree_at(
            lambda b: (b.rest_thread_length, b.turns),
            braid,
            (braid.rest_thread_length * ratio, braid.turns * ratio),
        )
        return EstimatedGeometry(longer, dataclasses.replace(bladder, rest_length=new))
    raise ValueError(
        f"only an estimated geometry can be cut to another length, got {type(geometry).__name__}: "
        "a measured or assumed shape is that of one length"
    )
