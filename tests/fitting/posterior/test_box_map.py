"""The map into a box against its own derivative, its ends, and the normal that it straightens."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fitting.density import BoxMap


@pytest.fixture
def ridge() -> BoxMap:
    """Two parameters correlated by -0.999, the mean beyond a bound, and one far from every bound."""
    std = np.array([0.3, 0.2, 0.01])
    correlation = np.array([[1, -0.999, 0], [-0.999, 1, 0.02], [0, 0.02, 1]])
    spread = correlation * np.outer(std, std)
    return BoxMap.of(np.zeros(3), np.ones(3), np.array([1.2, 0.3, 0.5]), spread)


@pytest.mark.slow
def test_volume_is_that_of_the_derivative(ridge: BoxMap) -> None:
    rng = np.random.default_rng(0)
    bent = ridge.along(np.linspace(0.5, 1, 7), {1: 0.3 + np.linspace(0, 1, 7) ** 3})

    @eqx.filter_jit
    def all_at(box: BoxMap, z: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        return *jax.vmap(box)(z), jax.vmap(jax.jacfwd(lambda z: box(z)[0]))(z)

    for box in (ridge, bent):
        v, log_volume, slopes = all_at(box, jnp.asarray(rng.normal(scale=2, size=(20, 3))))
        assert (v >= 0).all()
        assert (v <= 1).all()
        np.testing.assert_allclose(np.linalg.slogdet(slopes)[1], log_volume, rtol=1e-9)


@pytest.mark.parametrize("z", [-300.0, -30.0, 30.0, 300.0])
def test_far_out_it_stays_finite_and_inside(ridge: BoxMap, z: float) -> None:
    at = jnp.full(3, z)
    v, log_volume = ridge(at)
    assert np.isfinite(log_volume)
    assert np.isfinite(jax.grad(lambda z: ridge(z)[1])(at)).all()
    assert (v > -1e-12).all()
    assert (v < 1 + 1e-12).all()


def test_far_from_bounds_it_is_the_linear_map() -> None:
    spread = np.array([[1e-4, 5e-5], [5e-5, 1e-4]])
    box = BoxMap.of(np.zeros(2), np.ones(2), np.full(2, 0.5), spread)
    z = np.array([0.7, -1.1])
    v, _ = box(jnp.asarray(z))
    np.testing.assert_allclose(v[box.order], 0.5 + np.linalg.cholesky(spread) @ z, rtol=1e-12)
