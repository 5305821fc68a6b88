"""A problem in JAX is the engine's, jitted or not, and has the derivatives of differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax.compile_options import quick_jit
from fitting import ForceData, Parameter, identify
from fitting.engine import solve
from fitting.posing import pose
from fitting.problem import PureProblem
from fitting.search import descend

STEP = 0.4  # N: of differences
DIFFERENCES = 1e-6  # relative: 1.6e-8 were found, and the ends are known to 1e-9


def test_the_convex_fit_is_the_engine_s_and_its_gradient_that_of_differences(
    dmsp20: ForceData,
) -> None:
    problem = pose((dmsp20,), order=2).problem
    pure, force = PureProblem.of(problem), jnp.asarray(problem.force)
    u = np.random.default_rng(0).uniform(0.05, 0.95, (3, problem.free.size))
    parameters = np.stack([problem.parameters(one) for one in u])

    @quick_jit
    def several(parameters: jax.Array) -> jax.Array:
        return jax.vmap(lambda p: pure.coefficients(p, force))(parameters)

    for p, x in zip(parameters, np.asarray(several(jnp.asarray(parameters))), strict=True):
        np.testing.assert_allclose(x, solve(problem, p).x, rtol=1e-9)

    def first(u: jax.Array) -> jax.Array:
        return pure.coefficients(pure.parameters(u), force)[0]

    slope, value = quick_jit(jax.grad(first))(jnp.asarray(u[0])), quick_jit(first)
    moves = 1e-6 * np.eye(u.shape[1])
    central = [(value(u[0] + move) - value(u[0] - move)) / 2e-6 for move in moves]
    np.testing.assert_allclose(slope, central, rtol=0, atol=1e-6 * np.abs(central).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [{}, {"law": "saturating", "parameters": {"series_compliance": Parameter()}}],
    ids=["rigid", "compliant"],
)
def test_the_derivative_goes_through_the_fit(dmsp20: ForceData, options: dict) -> None:
    result = identify(dmsp20, starts=4, **options)
    problem, near = result.problem, result.end.point
    towards = np.random.default_rng(1).normal(size=problem.force.size)
    pure = PureProblem.of(problem)

    @quick_jit
    def slope(force: jax.Array, along: jax.Array) -> tuple[jax.Array, ...]:
        def numbers(force: jax.Array) -> tuple[jax.Array, jax.Array]:
            return pure.differentiable(force, near)

        return jax.jvp(numbers, (force,), (along,))[1]

    found = slope(jnp.asarray(problem.force), jnp.asarray(towards))
    ends = [
        descend(
            problem.with_readings(force=problem.force + sign * STEP * towards),
            # From the optimum itself a single step is made, and what it leaves grows with STEP.
            0.7 * result.end.u + 0.1,
            tolerance=1e-13,
        )
        for sign in (1, -1, 2, -2)
    ]
    for mine, of in zip(found, ("parameters", "x"), strict=True):
        after, before, far, back = (getattr(end.point, of) for end in ends)
        difference = (8 * (after - before) - (far - back)) / (12 * STEP)
        size = np.abs(difference).max()
        np.testing.assert_allclose(mine / size, difference / size, atol=DIFFERENCES)
