"""Where a muscle's model may be trusted: the lengths and pressures of the data, if it is monotone."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._types import Given, RealArray, as_number
from ..boundary.errors import InputError
from ..compile_options import quick_jit
from .abstract_muscle import AbstractMuscle

if TYPE_CHECKING:
    AnyArray = Any  # NumPy's or JAX's
else:
    AnyArray = Array | np.ndarray

LENGTHS, PRESSURES = 33, 65
"""Grid on which the model is looked at, lines of each."""


class Region(eqx.Module):
    """A range of lengths and one of pressures.

    Attributes:
        length: shortest and longest active length [m], shape (2,).
        pressure: lowest and highest gauge pressure [Pa], shape (2,).
    """

    length: Float[Given, "2"] = eqx.field(converter=as_number)
    pressure: Float[Given, "2"] = eqx.field(converter=as_number)

    @classmethod
    def of(cls, length: Sequence[float] | np.ndarray, pressure: Sequence[float] | np.ndarray):
        """The least region that holds these lengths [m] and pressures [Pa], of any number.

        Raises:
            InputError: they are not finite, negative, or span nothing.
        """
        L, P = np.asarray(length, float), np.asarray(pressure, float)
        for name, values, unit in (("lengths", L, "m"), ("pressures", P, "Pa")):
            if not (values.size and np.isfinite(values).all() and values.min() >= 0):
                raise InputError(f"{name} must be finite and >= 0, got {values} {unit}")
            if not values.max() > values.min():
                raise InputError(f"a region needs two {name} that differ, got {values} {unit}")
        return cls([L.min(), L.max()], [P.min(), P.max()])


class Slopes(NamedTuple):
    """A force with its slopes, all of one shape.

    Attributes:
        force: F [N].
        stiffness: dF/dL [N/m].
        area: dF/dP [m2].
        stiffening: d2F/dLdP [m].
    """

    force: AnyArray
    stiffness: AnyArray
    area: AnyArray
    stiffening: AnyArray


def slopes(muscle: AbstractMuscle, length: RealArray, pressure: RealArray) -> Slopes:
    """Force and slopes at lengths [m] and pressures [Pa] of one shape."""
    along = jnp.ones_like(length), jnp.ones_like(pressure)

    def in_length(pressure: RealArray) -> tuple[RealArray, RealArray]:
        return jax.jvp(lambda L: muscle.force(L, pressure), (length,), along[:1])

    (force, stiffness), (area, stiffening) = jax.jvp(in_length, (pressure,), along[1:])
    return Slopes(force, stiffness, area, stiffening)


def grid_slopes(muscle: AbstractMuscle, region: Region) -> Slopes:
    """Force and slopes on the grid over a region, each of shape (LENGTHS, PRESSURES)."""
    L = jnp.linspace(region.length[0], region.length[1], LENGTHS)
    P = jnp.linspace(region.pressure[0], region.pressure[1], PRESSURES)
    return slopes(muscle, *jnp.meshgrid(L, P, indexing="ij"))


def rising(at: Slopes) -> Bool[Array | np.ndarray, "lengths pressures"]:
    """Where the force is finite and falls neither with the length nor with the pressure."""
    finite = abs(sum(at)) < np.inf
    return finite & (at.stiffness >= 0) & (at.area >= 0)


def rising_region(muscle: AbstractMuscle, data: Region) -> tuple[Region, Slopes]:
    """The largest part of a region in which the pull falls neither with length nor with pressure.

    Looked for among the rectangles of a grid of 33 lengths and 65 pressures, by their area. It is
    the whole region where the model allows. On the host: it cannot be traced.

    Args:
        muscle: the model.
        data: the region of the data.

    Returns:
        (the part, force and slopes at the grid's lines in it).

    Raises:
        InputError: there is no such part of two cells by two.
    """
    at = Slopes(*(np.asarray(one) for one in _grid_slopes(muscle, data)))
    good = np.asarray(rising(at))
    if good.all():
        return data, at
    (i0, i1), (j0, j1) = (
        _inner(low, high, count - 1)
        for (low, high), count in zip(largest_block(good), good.shape, strict=True)
    )
    L = np.linspace(float(data.length[0]), float(data.length[1]), LENGTHS)
    P = np.linspace(float(data.pressure[0]), float(data.pressure[1]), PRESSURES)
    if min(i1 - i0, j1 - j0) < 2:
        raise InputError(
            "the model has no region in which its pull rises with length and pressure: of "
            f"{good.size} states between {L[0]:.4g} and {L[-1]:.4g} m, {P[0]:.4g} and {P[-1]:.4g} Pa "
            f"{good.sum()} do. It cannot be continued safely: look at its stiffness, and at the units"
        )
    part = Slopes(*(one[i0 : i1 + 1, j0 : j1 + 1] for one in at))
    return Region([L[i0], L[i1]], [P[j0], P[j1]]), part


_grid_slopes = quick_jit(grid_slopes)


def largest_share(good: Bool[np.ndarray, "lengths pressures"]) -> float:
    """Share [-] of a grid's cells in the largest rectangle in which all is good."""
    if good.all():
        return 1.0
    (i0, i1), (j0, j1) = largest_block(good)
    return (i1 - i0) * (j1 - j0) / float(np.prod(np.subtract(good.shape, 1)))


def _inner(low: int, high: int, last: int) -> tuple[int, int]:
    """One line in from an end that is not the data's: what just rises on it may fall between its states."""
    return low + (low > 0), high - (high < last)


def largest_block(good: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    """First and last lines of the largest rectangle of a grid in which all is good."""
    bad = np.pad(np.cumsum(np.cumsum(~good, 0), 1), ((1, 0), (1, 0)))
    best, found = -1, ((0, 0), (0, 0))
    for low in range(good.shape[0]):
        for high in range(low, good.shape[0]):
            strip = bad[high + 1] - bad[low]  # bad states in columns before each
            clean = strip[None, 1:] == strip[:-1, None]  # [first, last]
            first, last = np.nonzero(np.triu(clean))
            if not first.size:
                continue
            k = int(np.argmax(last - first))
            area = (high - low) * int(last[k] - first[k])
            if area > best:
                best, found = area, ((low, high), (int(first[k]), int(last[k])))
    return found
