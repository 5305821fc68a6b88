"""Laws that every public formula obeys: jit, vmap, derivatives, precision, units."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from famjax import braids, geometries, terms


class Formula(NamedTuple):
    """A public formula, sample arguments, and the dimension (length, pressure) of each."""

    function: Callable
    arguments: tuple[float, ...]
    dimensions: tuple[tuple[int, int], ...]
    result: tuple[int, int]


LENGTH, AREA, VOLUME, PRESSURE, NUMBER, FORCE = (1, 0), (2, 0), (3, 0), (0, 1), (0, 0), (2, 1)


def braid_angle_from_blocked_force(
    pressure: jax.Array | float, force: jax.Array | float, diameter: jax.Array | float
) -> jax.Array:
    """The public formula of three readings, which are multiples of one."""
    steps = jnp.arange(1, 4)
    P, F = (jnp.asarray(value)[..., None] * steps for value in (pressure, force))
    return famjax.braids.braid_angle_from_blocked_force(P, F, diameter)


FORMULAS = {
    f.function.__name__: f
    for f in [
        Formula(famjax.braids.thread_length_from_angle, (0.3, 1.1), (LENGTH, NUMBER), LENGTH),
        Formula(famjax.braids.turns_from_angle, (0.3, 0.02, 1.1), (LENGTH, LENGTH, NUMBER), NUMBER),
        Formula(
            famjax.braids.diameter_from_length, (0.3, 0.34, 2.1), (LENGTH, LENGTH, NUMBER), LENGTH
        ),
        Formula(
            famjax.braids.length_from_diameter, (0.02, 0.34, 2.1), (LENGTH, LENGTH, NUMBER), LENGTH
        ),
        Formula(famjax.braids.braid_angle_from_length, (0.3, 0.34), (LENGTH, LENGTH), NUMBER),
        Formula(
            famjax.braids.braid_angle_from_diameter,
            (0.03, 0.02, 1.1),
            (LENGTH, LENGTH, NUMBER),
            NUMBER,
        ),
        Formula(famjax.geometries.cylinder_volume, (0.3, 0.01), (LENGTH, LENGTH), VOLUME),
        Formula(
            famjax.geometries.tube_volume, (0.3, 0.02, 0.002), (LENGTH, LENGTH, LENGTH), VOLUME
        ),
        Formula(
            famjax.geometries.bladder_thickness, (0.3, 0.01, 4e-5), (LENGTH, LENGTH, VOLUME), LENGTH
        ),
        Formula(famjax.braids.force_magnification, (1.1,), (NUMBER,), NUMBER),
        Formula(famjax.braids.gaylord_force, (5e5, 0.01, 1.1), (PRESSURE, LENGTH, NUMBER), FORCE),
        Formula(
            braid_angle_from_blocked_force, (2e5, 400.0, 0.02), (PRESSURE, FORCE, LENGTH), NUMBER
        ),
        Formula(
            famjax.terms.bladder_axial_force, (-1e6, 4e-5, 0.3), (PRESSURE, VOLUME, LENGTH), FORCE
        ),
        Formula(
            famjax.terms.bladder_hoop_force,
            (1e6, 2e-3, 0.3, 0.01, 2.1),
            (PRESSURE, LENGTH, LENGTH, LENGTH, NUMBER),
            FORCE,
        ),
    ]
}
EXACT = 1e-13  # a few roundings in float64
DIFFERENCE = 1e-6  # central ones with a step of 1e-4, of functions of order one
SINGLE = 2e-5  # a few roundings in float32, amplified by one subtraction


@pytest.fixture(params=FORMULAS.values(), ids=FORMULAS.keys())
def formula(request: pytest.FixtureRequest) -> Formula:
    return request.param


def _batch(formula: Formula) -> list[jnp.ndarray]:
    steps = jnp.linspace(0.99, 1.01, 5)
    return [jnp.asarray(value) * steps for value in formula.arguments]


def test_jit_equals_eager(formula: Formula) -> None:
    eager = formula.function(*formula.arguments)
    np.testing.assert_allclose(jax.jit(formula.function)(*formula.arguments), eager, rtol=EXACT)


def test_vmap_and_broadcast_equal_loop(formula: Formula) -> None:
    batch = _batch(formula)
    loop = [formula.function(*(float(column[k]) for column in batch)) for k in range(5)]
    np.testing.assert_allclose(jax.jit(jax.vmap(formula.function))(*batch), loop, rtol=EXACT)
    np.testing.assert_allclose(formula.function(*batch), loop, rtol=EXACT)


def test_derivatives_match_finite_differences(formula: Formula) -> None:
    """Forward, reverse and second ones in all arguments, each in parts of its own size."""
    size, step = jnp.array(formula.arguments), 1e-4
    unit = formula.function(*formula.arguments)
    ways = step * jnp.eye(size.size)

    def of_parts(parts: jax.Array) -> jax.Array:
        return formula.function(*(parts * size)) / unit

    def difference(of: Callable[[jax.Array], jax.Array], parts: jax.Array) -> jax.Array:
        return jax.vmap(lambda way: (of(parts + way) - of(parts - way)) / (2 * step))(ways)

    @jax.jit  # one program
    def derivatives(parts: jax.Array) -> tuple[jax.Array, ...]:
        reverse = jax.jacrev(of_parts)
        return (
            jax.jacfwd(of_parts)(parts),
            reverse(parts),
            difference(of_parts, parts),
            jax.jacfwd(reverse)(parts),
            difference(reverse, parts),
        )

    forward, reverse, slope, second, curvature = derivatives(jnp.ones(size.size))
    np.testing.assert_allclose(forward, slope, rtol=DIFFERENCE, atol=DIFFERENCE)
    np.testing.assert_allclose(reverse, slope, rtol=DIFFERENCE, atol=DIFFERENCE)
    np.testing.assert_allclose(second, curvature, rtol=DIFFERENCE, atol=DIFFERENCE)


def test_float32_in_float32_out(formula: Formula) -> None:
    single = formula.function(*(jnp.float32(value) for value in formula.arguments))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, formula.function(*formula.arguments), rtol=SINGLE)


def test_formula_is_homogeneous_in_units(formula: Formula) -> None:
    length, pressure = 1 / 0.0254, 1 / 6894.757
    other = [
        value * length**i * pressure**j
        for value, (i, j) in zip(formula.arguments, formula.dimensions, strict=True)
    ]
    i, j = formula.result
    expected = formula.function(*formula.arguments) * length**i * pressure**j
    np.testing.assert_allclose(formula.function(*other), expected, rtol=EXACT)


WITH_TESTS_OF_THEIR_OWN = {
    "crossing_area", "cylinder_dimensions", "pressure_terms", "smooth_sign", "strain_under_cubic",
    "strain_under_line", "thread_contact_area", "thread_tension", "virtual_work_force", "volume_rate",
}  # fmt: skip


def test_every_public_function_is_in_the_registry() -> None:
    public = {
        name
        for module in (braids, geometries, terms)
        for name, value in vars(module).items()
        if getattr(value, "__module__", None) == module.__name__ and name[0].islower()
    }
    assert public == set(FORMULAS) | WITH_TESTS_OF_THEIR_OWN
