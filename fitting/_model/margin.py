"""The stability margin between grid points: where on the actuation path the law is weakest."""

import functools
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from .part import Part
from .problem import Problem, tangent_modulus

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
    part: Part,
    parameters: Float[Array, " q"],
    material: famjax.AbstractMaterial,
    stations: Float[Array, "*paths k"],
) -> Float[Array, "*paths k"]:
    at = eqx.tree_at(lambda p: p.stations, part, stations)
    return famjax.path_modulus(
        material,
        part.source.geometry(part.values(parameters)),
        at.path_lengths(parameters),
        part.path_pressure[..., None],
    )


@eqx.filter_jit
def _largest_strain(part: Part, parameters: Float[Array, " q"]) -> Float[Array, "blocks paths"]:
    return part.largest_strain(parameters)


_tangent_modulus = eqx.filter_jit(tangent_modulus)

Found = list[tuple[Float[np.ndarray, "blocks paths"], Float[np.ndarray, "blocks paths"]]]
"""For each part: the stations in [0, 1] at which its paths are weakest, and the moduli [Pa]."""


def path_margin(
    problem: Problem, parameters: Float[Array, " q"], x: Float[Array, "blocks n"]
) -> Found:
    """Smallest modulus along each actuation path: Drucker-stable where >= 0."""
    return [
        smallest_on_path(
            functools.partial(_path_moduli, part, parameters, material), part.path_end.shape
        )
        for part, material in zip(problem.parts, problem.materials(parameters, x), strict=True)
    ]


def slope_margin(
    problem: Problem, parameters: Float[Array, " q"], x: Float[Array, "blocks n"]
) -> Found:
    """Smallest tangent modulus on [0, largest strain] of each path; nan where directions interact.

    Exact for polynomials: the minimum is at an end or at a real root of the derivative.
    """
    found = []
    for part, material in zip(problem.parts, problem.materials(parameters, x), strict=True):
        largest = np.asarray(_largest_strain(part, parameters))
        if isinstance(material, famjax.PolynomialMaterial):
            coefficients = np.broadcast_to(
                material.coefficients, (*largest.shape, *material.coefficients.shape)
            )
            found.append(_polynomial_slope(coefficients, largest))
        elif isinstance(material, famjax.PressurePolynomialMaterial):
            coefficients = np.asarray(material.coefficients_at(part.path_pressure))
            found.append(_polynomial_slope(coefficients, largest))
        elif isinstance(material, famjax.AbstractUniaxialLaw):

            def at_stations(
                stations: Float[Array, "*paths k"], material=material, largest=largest
            ) -> Float[Array, "*paths k"]:
                return _tangent_modulus(material, stations * largest[..., None])

            found.append(smallest_on_path(at_stations, largest.shape))
        else:
            found.append((np.zeros(largest.shape), np.full(largest.shape, np.nan)))
    return found


def _polynomial_slope(
    coefficients: np.ndarray, largest: np.ndarray
) -> tuple[Float[np.ndarray, "blocks paths"], Float[np.ndarray, "blocks paths"]]:
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
