"""Profiles by their formulas and by geometry: the series, and the shapes that others assume."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from famjax.profiles import EllipticToroidEnds, FourierProfile, kothera_length, tondu_lopez_length

EXACT = 1e-12
X = np.linspace(0, 1, 51)


def _by_hand(x: np.ndarray, a0: float, a: list[float], b: list[float], w: float) -> np.ndarray:
    total = np.full_like(x, a0)
    for n, (cosine, sine) in enumerate(zip(a, b, strict=True), start=1):
        total += cosine * np.cos(n * w * x) + sine * np.sin(n * w * x)
    return total


@pytest.mark.parametrize("terms", [0, 1, 5])
def test_series_of_any_number_of_terms(terms: int) -> None:
    rng = np.random.default_rng(terms)
    a, b = 0.05 * rng.standard_normal((2, terms))
    profile = FourierProfile(1.5, a, b, -5.3)
    by_hand = _by_hand(X, 1.5, list(a), list(b), -5.3)
    np.testing.assert_allclose(profile.diameter(X, 9.0), by_hand, rtol=EXACT)


MIDDLE, END, A, LENGTH = 2.2, 0.9, 1.1, 6.0
RADIUS = (MIDDLE - END) / 2
CIRCULAR = EllipticToroidEnds(MIDDLE, END, RADIUS)


@pytest.mark.parametrize("arc", [1.0, math.pi / 2])
def test_a_toroid_is_symmetric_and_between_its_two_diameters(arc: float) -> None:
    shape = EllipticToroidEnds(MIDDLE, END, A, arc)
    diameter = shape.diameter(X, LENGTH)
    np.testing.assert_allclose(diameter, shape.diameter(1 - X, LENGTH), rtol=EXACT)
    np.testing.assert_allclose(diameter[np.array([0, 25])], [END, MIDDLE], rtol=EXACT)
    assert bool(jnp.all(jnp.diff(diameter[:26]) >= -EXACT))


def test_kothera_is_the_length_between_the_arcs() -> None:
    first, second = CIRCULAR.breakpoints(LENGTH)
    between = float((second - first) * LENGTH)
    assert float(kothera_length(LENGTH, MIDDLE / 2, END / 2)) == pytest.approx(between, rel=EXACT)


def test_tondu_lopez() -> None:
    length = jnp.array([0.30, 0.27, 0.24])
    np.testing.assert_allclose(tondu_lopez_length(length, 0.3, 1.0), length, rtol=EXACT)
    # Their force, pi r0^2 P (a (1 - k eps)^2 - b), is Gaylord's at this length.
    r0, angle, k, P = 0.01, 1.2, 1.25, 3e5
    a, b = 3 * math.tan(angle) ** 2, 1 / math.cos(angle) ** 2
    contraction = 1 - length / 0.3
    published = math.pi * r0**2 * P * (a * (1 - k * contraction) ** 2 - b)
    thread, turns = 0.3 / math.sin(angle), 0.3 / (2 * math.pi * r0 * math.tan(angle))
    L = tondu_lopez_length(length, 0.3, k)
    gaylord = P * (3 * L**2 - thread**2) / (4 * math.pi * turns**2)
    np.testing.assert_allclose(gaylord, published, rtol=EXACT)
