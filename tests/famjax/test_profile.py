import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from famjax.profiles import FourierProfile

EXACT = 1e-12
X = np.linspace(0, 1, 41)
ROW = (1.27, [-0.83, 0.29, 0.18], [1.20, 0.75, 0.04], 4.347)  # Chambers 2021, 26.25 %


def _by_hand(x: np.ndarray, a0: float, a: list[float], b: list[float], w: float) -> np.ndarray:
    total = np.full_like(x, a0)
    for n, (cosine, sine) in enumerate(zip(a, b, strict=True), start=1):
        total += cosine * np.cos(n * w * x) + sine * np.sin(n * w * x)
    return total


@pytest.mark.parametrize("terms", range(6))
def test_series_of_any_number_of_terms(terms: int) -> None:
    rng = np.random.default_rng(terms)
    a, b = 0.05 * rng.standard_normal((2, terms))
    profile = FourierProfile(1.5, a, b, -5.3)
    by_hand = _by_hand(X, 1.5, list(a), list(b), -5.3)
    np.testing.assert_allclose(profile.diameter(X, 9.0), by_hand, rtol=EXACT)


def test_length_only_sets_the_shape() -> None:
    profile = FourierProfile(*ROW)
    diameter = profile.diameter(X, jnp.array([[6.0], [9.0]]))
    assert diameter.shape == (2, X.size)
    np.testing.assert_array_equal(diameter[0], diameter[1])
    assert profile.breakpoints(jnp.ones(4)).shape == (4, 0)


def test_symmetric_is_symmetric_and_has_the_given_cosines() -> None:
    a = np.array([-0.09, -0.07, -0.01])
    profile = FourierProfile.symmetric(1.02, a, 5.596)
    np.testing.assert_allclose(profile.diameter(X, 1.0), profile.diameter(1 - X, 1.0), rtol=EXACT)
    np.testing.assert_array_equal(profile.a, a)
    # Table 4.3 prints the sines of this row, rounded to 0.01.
    np.testing.assert_allclose(profile.b, [0.03, 0.06, 0.02], atol=0.0051)


def test_symmetrised_is_the_even_part() -> None:
    profile = FourierProfile(*ROW)
    even = profile.symmetrised()
    expected = (profile.diameter(X, 1.0) + profile.diameter(1 - X, 1.0)) / 2
    np.testing.assert_allclose(even.diameter(X, 1.0), expected, rtol=EXACT)
    n = np.arange(1, 4)
    np.testing.assert_allclose(even.b, even.a * np.tan(n * even.w / 2), rtol=EXACT)


def test_rows_that_are_not_symmetric_do_not_pass_for_it() -> None:
    profile = FourierProfile(1.0, [0.1], [0.0], 2.0)
    assert abs(profile.diameter(0.0, 1.0) - profile.diameter(1.0, 1.0)) > 0.1


def test_negative_diameter_is_refused_with_its_place() -> None:
    with pytest.raises(ValueError, match=r"must be > 0 .* it is -0\.9 at x = 1\.000"):
        FourierProfile(0.1, [1.0], [0.0], np.pi)


def test_coefficients_must_match() -> None:
    with pytest.raises(ValueError, match=r"one coefficient per term.*\(2,\) and \(3,\)"):
        FourierProfile(1.0, [0.1, 0.2], [0.1, 0.2, 0.3], 5.0)


def test_derivatives() -> None:
    def diameter(x: jax.Array, a0: jax.Array, a: jax.Array, b: jax.Array, w: jax.Array):
        return FourierProfile(a0, a, b, w).diameter(x, 1.0)

    values = (jnp.array(0.3), *(jnp.asarray(value) for value in ROW))
    # Second differences: five digits.
    check_grads(jax.jit(diameter), values, order=2, atol=1e-4, rtol=1e-4)


def test_jit_and_vmap_equal_eager() -> None:
    profile = FourierProfile(*ROW)
    eager = profile.diameter(X, 1.0)
    np.testing.assert_allclose(jax.jit(lambda x: profile.diameter(x, 1.0))(X), eager, rtol=EXACT)
    batched = jax.jit(jax.vmap(lambda x, w: FourierProfile(*ROW[:3], w).diameter(x, 1.0)))
    np.testing.assert_allclose(batched(X, np.full(X.shape, ROW[3])), eager, rtol=EXACT)


def test_float32_stays_float32() -> None:
    profile = jax.tree.map(lambda leaf: leaf.astype(np.float32), FourierProfile(*ROW))
    diameter = profile.diameter(np.float32(X), np.float32(1))
    assert diameter.dtype == np.float32
    np.testing.assert_allclose(diameter, _by_hand(X, *ROW), rtol=3e-6)  # about ten roundings
