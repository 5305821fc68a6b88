"""The fit in JAX is the fit on the host, for a batch, and has the derivatives of differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax.compile_options import quick_jit
from fitting import ForceData, Parameter, identify
from fitting.engine.batched import Batched, BatchedFit
from fitting.engine.descent import descend

pytestmark = pytest.mark.slow

AGREE = 1e-9  # relative: two drivers of one problem
STEP = 0.1  # N: of differences
DIFFERENCES = 1e-6  # relative: 1.6e-8 were found, and the ends are known to 1e-9
RIGID = {"order": 2}
COMPLIANT = {"law": "saturating", "parameters": {"series_compliance": Parameter()}}


@pytest.mark.parametrize("options", [RIGID, COMPLIANT], ids=["rigid", "compliant"])
def test_a_batch_is_the_host(dmsp20: ForceData, options: dict) -> None:
    result = identify(dmsp20, starts=4, **options)
    problem, u = result.problem, jnp.asarray(result.end.u)
    drawn = problem.force + np.random.default_rng(0).normal(0, 3, (2, problem.force.size))

    @quick_jit
    def fits(batched: Batched, forces: jax.Array) -> BatchedFit:
        return jax.vmap(lambda force: batched.descend(force, jnp.ones_like(force), u))(forces)

    found = fits(Batched.of(problem), jnp.asarray(drawn))
    assert np.asarray(found.converged).all()
    for k, force in enumerate(drawn):
        end = descend(problem.with_readings(force=force), result.end.u)
        assert float(found.cost[k]) == pytest.approx(end.cost, rel=AGREE)
        np.testing.assert_allclose(found.x[k], end.point.x, rtol=1e-6)


def test_the_derivative_goes_through_the_fit(dmsp20: ForceData) -> None:
    result = identify(dmsp20, starts=4)
    problem, u = result.problem, jnp.asarray(result.end.u)
    towards = np.random.default_rng(1).normal(size=problem.force.size)

    @quick_jit
    def slope(batched: Batched, force: jax.Array, along: jax.Array) -> tuple[jax.Array, ...]:
        def numbers(force: jax.Array) -> tuple[jax.Array, jax.Array]:
            fit = batched.differentiable(force, u)
            return fit.parameters, fit.x

        return jax.jvp(numbers, (force,), (along,))[1]

    found = slope(Batched.of(problem), jnp.asarray(problem.force), jnp.asarray(towards))
    ends = [
        descend(
            problem.with_readings(force=problem.force + sign * STEP * towards),
            # From the optimum itself a single step is made, and what it leaves grows with STEP.
            0.7 * result.end.u + 0.1,
            tolerance=1e-13,
        )
        for sign in (1, -1)
    ]
    for mine, of in zip(found, ("parameters", "x"), strict=True):
        after, before = (getattr(end.point, of) for end in ends)
        difference = (after - before) / (2 * STEP)
        size = np.abs(difference).max()
        np.testing.assert_allclose(mine / size, difference / size, atol=DIFFERENCES)
