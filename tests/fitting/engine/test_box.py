import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize

from fitting.engine.box import minimise_in_box


def _curve(u: jnp.ndarray) -> jnp.ndarray:
    x = jnp.linspace(0, 1, 20)
    return 2 * u[0] * jnp.exp(-3 * u[1] * x) + u[2] * x - (1.7 * jnp.exp(-1.2 * x) + 1.4 * x)


def test_bound_is_met_exactly_and_agrees_with_scipy() -> None:
    end = minimise_in_box(_curve, jnp.array([0.3, 0.6, 0.2]))
    theirs = optimize.least_squares(
        lambda u: np.asarray(_curve(jnp.asarray(u))),
        [0.3, 0.6, 0.2],
        bounds=(0, 1),
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    assert bool(end.converged)
    assert float(end.u[2]) == 1.0
    assert float(end.cost) <= theirs.cost * (1 + 1e-9)
    assert float(end.gradient_residual) < 1e-8
    np.testing.assert_allclose(end.u, theirs.x, atol=1e-5)


def test_interior_optimum_of_a_curved_valley() -> None:
    """Rosenbrock's valley, scaled so that its floor (1, 1) is at (0.5, 0.5)."""

    def valley(u: jnp.ndarray) -> jnp.ndarray:
        x, y = 2 * u
        return jnp.stack([10 * (y - x**2), 1 - x])

    end = minimise_in_box(valley, jnp.array([0.05, 0.9]))
    assert bool(end.converged)
    np.testing.assert_allclose(end.u, 0.5, atol=1e-8)


def test_nothing_to_move() -> None:
    end = minimise_in_box(lambda u: jnp.array([2.0]), jnp.zeros(0))
    assert float(end.cost) == pytest.approx(2.0)
    assert bool(end.converged)
