"""Profiles by their formulas and by geometry: the series, and the shapes that others assume."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from famjax.profiles import (
    AbstractAssumedShape,
    CircularArcEnds,
    ConicFrustumEnds,
    Cylinder,
    EllipticToroidEnds,
    FourierProfile,
    SemiEllipsoidEnds,
    SteppedCylinder,
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


MIDDLE, END, A, LENGTH = 2.2, 0.9, 1.1, 6.0
SHAPES: dict[str, AbstractAssumedShape] = {
    "cylinder": Cylinder(MIDDLE),
    "stepped": SteppedCylinder(MIDDLE, END, A),
    "frustum": ConicFrustumEnds(MIDDLE, END, A),
    "ellipsoid": SemiEllipsoidEnds(MIDDLE, END, A),
    "circular": CircularArcEnds(MIDDLE, END),
    "toroid": EllipticToroidEnds(MIDDLE, END, A, 1.0),
}


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_is_symmetric_and_between_its_two_diameters(name: str) -> None:
    shape = SHAPES[name]
    diameter = shape.diameter(X, LENGTH)
    np.testing.assert_allclose(diameter, shape.diameter(1 - X, LENGTH), rtol=EXACT)
    assert float(diameter[25]) == pytest.approx(MIDDLE, rel=EXACT)
    if name != "cylinder":
        assert float(diameter[0]) == pytest.approx(END, rel=EXACT)
    assert bool(jnp.all(jnp.diff(diameter[:26]) >= -EXACT))


def test_circular_arc_is_a_circle() -> None:
    shape = CircularArcEnds(MIDDLE, END)
    r = (MIDDLE - END) / 2
    z = np.linspace(0, r, 30)
    height = np.asarray(shape.diameter(z / LENGTH, LENGTH)) / 2 - END / 2
    np.testing.assert_allclose((r - z) ** 2 + height**2, r**2, rtol=EXACT)


def test_circular_arc_is_a_quarter_of_a_round_toroid() -> None:
    toroid = EllipticToroidEnds(MIDDLE, END, (MIDDLE - END) / 2, math.pi / 2)
    circle = CircularArcEnds(MIDDLE, END)
    np.testing.assert_allclose(
        toroid.diameter(X, LENGTH), circle.diameter(X, LENGTH), rtol=EXACT, atol=1e-8
    )  # cos(pi / 2) is not quite zero under the root at x = 0


def test_a_slight_arc_is_a_parabola() -> None:
    toroid = EllipticToroidEnds(MIDDLE, END, A, 1e-3)
    zeta = np.linspace(0, 1, 20)
    parabola = END + (MIDDLE - END) * zeta * (2 - zeta)
    np.testing.assert_allclose(toroid.diameter(zeta * A / LENGTH, LENGTH), parabola, rtol=1e-6)


def test_ellipsoid_is_an_ellipse_about_the_axis() -> None:
    shape = SemiEllipsoidEnds(MIDDLE, END, A)
    axis = A / math.sqrt(1 - (END / MIDDLE) ** 2)
    z = np.linspace(0, A, 30)
    radius = np.asarray(shape.diameter(z / LENGTH, LENGTH)) / 2
    np.testing.assert_allclose(((A - z) / axis) ** 2 + (2 * radius / MIDDLE) ** 2, 1, rtol=EXACT)


def test_stepped_cylinder_and_frustum_at_places() -> None:
    at = np.array([0.5 * A, A + 0.01, 3.0]) / LENGTH
    np.testing.assert_allclose(
        SteppedCylinder(MIDDLE, END, A).diameter(at, LENGTH), [END, MIDDLE, MIDDLE], rtol=EXACT
    )
    np.testing.assert_allclose(
        ConicFrustumEnds(MIDDLE, END, A).diameter(at, LENGTH),
        [(END + MIDDLE) / 2, MIDDLE, MIDDLE],
        rtol=EXACT,
    )


def test_kothera_is_the_length_between_the_arcs() -> None:
    first, second = CircularArcEnds(MIDDLE, END).breakpoints(LENGTH)
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
