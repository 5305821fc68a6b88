import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax


@pytest.mark.parametrize("order", [1, 2, 3, 4, 6])
def test_law_is_odd_and_its_tangent_at_zero_is_the_first_coefficient(order: int) -> None:
    law = famjax.PolynomialMaterial(jnp.arange(1.0, order + 1))
    strain = jnp.linspace(-1, 1, 11)
    np.testing.assert_allclose(law.stress(-strain), -law.stress(strain), rtol=1e-14)
    assert float(jax.jit(jax.grad(law.stress))(0.0)) == 1.0
    expected = sum((n + 1) * 0.5 ** (n + 1) for n in range(order))
    assert float(law.stress(0.5)) == pytest.approx(expected, rel=1e-14)


def test_pressure_law_interpolates_its_nodes() -> None:
    law = famjax.materials.PressurePolynomialMaterial([1e5, 3e5], [[1.0, 2.0], [3.0, 6.0]])
    np.testing.assert_allclose(law.coefficients_at(2e5), [2, 4])
    np.testing.assert_allclose(law.coefficients_at(4e5), [4, 8])  # two nodes: a linear law
    for P, node in ((1e5, [1, 2]), (3e5, [3, 6])):
        np.testing.assert_allclose(law.coefficients_at(P), node)


def test_free_law_knows_nothing_outside_its_nodes() -> None:
    law = famjax.materials.PressurePolynomialMaterial([1e5, 2e5, 3e5], [[1.0], [2.0], [5.0]])
    at = law.coefficients_at(jnp.array([0.5e5, 1e5, 2.5e5, 3e5, 3.1e5]))[:, 0]
    np.testing.assert_allclose(at, [np.nan, 1, 3.5, 5, np.nan])


def test_one_node_is_refused() -> None:
    with pytest.raises(ValueError, match="at least two node pressures"):
        famjax.materials.PressurePolynomialMaterial([1e5], [[1.0]])
