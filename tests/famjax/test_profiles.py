"""Profiles by their formulas and by geometry: the series, and the shapes that others assume."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from famjax.profiles import (
    EllipticToroidEnds,
    FourierProfile,
    kothera_length,
    tondu_lopez_length,
)

EXACT = 1e-12
X = np.linspace(0, 1, 51)


ROW = (1.27, [-0.83, 0.29, 0.18], [1.20, 0.75, 0.04], 4.347)  # Chambers 2021, 26.25 %


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


def test_a_quarter_of_a_round_toroid_is_a_circle() -> None:
    z = np.linspace(0, RADIUS, 30)
    height = np.asarray(CIRCULAR.diameter(z / LENGTH, LENGTH)) / 2 - END / 2
    np.testing.assert_allclose((RADIUS - z) ** 2 + height**2, RADIUS**2, rtol=EXACT)


def test_a_slight_arc_is_a_parabola() -> None:
    toroid = EllipticToroidEnds(MIDDLE, END, A, 1e-3)
    zeta = np.linspace(0, 1, 20)
    parabola = END + (MIDDLE - END) * zeta * (2 - zeta)
    np.testing.assert_allclose(toroid.diameter(zeta * A / LENGTH, LENGTH), parabola, rtol=1e-6)


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
