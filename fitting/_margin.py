"""The stability margin between grid points: where on the actuation path the law is weakest."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from ._problem import Problem

_GRID = 1025
_ZOOM = 33
_ZOOMS = 6


def smallest_on_path(
    evaluate: Callable[[Float[Array, "*paths k"]], Float[Array, "*paths k"]], paths: tuple[int, ...]
) -> tuple[Float[np.ndarray, "*paths"], Float[np.ndarray, "*paths"]]:
    """Global minimum over s in [0, 1] of a smooth function, for every path at once.

    A grid of 1025 points finds the cell; six zooms of 1/16 each refine it, so that the position is
    good to 1e-10 of the path and the value, being stationary there, to rounding.

    Args:
        evaluate: maps stations of shape (*paths, k) to values of that shape.
        paths: leading shape.

    Returns:
        (position, value), each of shape `paths`.
    """
    low, high = np.zeros(paths), np.ones(paths)
    position, value = low, np.full(paths, np.inf)
    for points in (_GRID, *[_ZOOM] * _ZOOMS):
        at = low[..., None] + (high - low)[..., None] * np.linspace(0, 1, points)
        values = np.asarray(evaluate(jnp.asarray(at)))
        best = np.argmin(values, axis=-1)[..., None]
        position = np.take_along_axis(at, best, -1)[..., 0]
        value = np.take_along_axis(values, best, -1)[..., 0]
        low = np.take_along_axis(at, np.maximum(best - 1, 0), -1)[..., 0]
        high = np.take_along_axis(at, np.minimum(best + 1, points - 1), -1)[..., 0]
    return position, value


@eqx.filter_jit
def _path_moduli(
    problem: Problem, muscle: famjax.Muscle, stations: Float[Array, "*paths k"]
) -> Float[Array, "*paths k"]:
    at = eqx.tree_at(lambda p: p.stations, problem, stations)
    return famjax.path_modulus(
        muscle.material, muscle.geometry, at.path_lengths(), problem.path_pressure[..., None]
    )


@eqx.filter_jit
def _largest_strain(problem: Problem, geometry: Float[Array, " 3"]) -> Float[Array, "blocks paths"]:
    return problem.largest_strain(geometry)


def path_margin(
    problem: Problem, geometry: Float[Array, " 3"], muscle: famjax.Muscle
) -> tuple[Float[np.ndarray, "blocks paths"], Float[np.ndarray, "blocks paths"]]:
    """Smallest modulus along each actuation path [Pa] and its station in [0, 1]: Drucker >= 0."""
    del geometry
    return smallest_on_path(
        lambda stations: _path_moduli(problem, muscle, stations), problem.path_end.shape
    )


def slope_margin(
    problem: Problem, geometry: Float[Array, " 3"], muscle: famjax.Muscle
) -> tuple[Float[np.ndarray, "blocks paths"], Float[np.ndarray, "blocks paths"]]:
    """Smallest tangent modulus [Pa] on [0, largest strain] of each path, and its part of it.

    Exact: the minimum of a polynomial is at an end or at a real root of its derivative.
    """
    largest = np.asarray(_largest_strain(problem, geometry))
    coefficients = _coefficients_on_paths(problem, muscle)
    position, value = np.zeros(largest.shape), np.zeros(largest.shape)
    for index in np.ndindex(largest.shape):
        tangent = np.polynomial.Polynomial([0.0, *coefficients[index]]).deriv()
        roots = tangent.deriv().roots()
        real = roots[np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))].real
        inside = real[(real > 0) & (real < largest[index])]
        strains = np.concatenate([[0.0, largest[index]], inside])
        moduli = tangent(strains)
        weakest = np.argmin(moduli)
        value[index] = moduli[weakest]
        position[index] = strains[weakest] / largest[index] if largest[index] > 0 else 0.0
    return position, value


def _coefficients_on_paths(problem: Problem, muscle: famjax.Muscle) -> np.ndarray:
    """Coefficients [Pa] at the pressure of each path, shape (blocks, paths, order)."""
    material = muscle.material
    if isinstance(material, famjax.PressurePolynomialMaterial):
        return np.asarray(material.coefficients_at(problem.path_pressure))
    assert isinstance(material, famjax.PolynomialMaterial)
    return np.broadcast_to(material.coefficients, (*problem.path_end.shape, problem.order))
