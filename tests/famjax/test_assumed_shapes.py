import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax.measured import Meridian
from famjax.profiles import (
    AbstractAssumedShape,
    CircularArcEnds,
    ConicFrustumEnds,
    Cylinder,
    EllipticToroidEnds,
    SemiEllipsoidEnds,
    SteppedCylinder,
    kothera_length,
    tondu_lopez_length,
)

EXACT = 1e-12
MIDDLE, END, A, LENGTH = 2.2, 0.9, 1.1, 6.0
SHAPES: dict[str, AbstractAssumedShape] = {
    "cylinder": Cylinder(MIDDLE),
    "stepped": SteppedCylinder(MIDDLE, END, A),
    "frustum": ConicFrustumEnds(MIDDLE, END, A),
    "ellipsoid": SemiEllipsoidEnds(MIDDLE, END, A),
    "circular": CircularArcEnds(MIDDLE, END),
    "toroid": EllipticToroidEnds(MIDDLE, END, A, 1.0),
}
X = np.linspace(0, 1, 51)
INSIDE = np.linspace(0.01, 0.99, 50)  # where no tangent is vertical


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_is_symmetric_and_between_its_two_diameters(name: str) -> None:
    shape = SHAPES[name]
    diameter = shape.diameter(X, LENGTH)
    np.testing.assert_allclose(diameter, shape.diameter(1 - X, LENGTH), rtol=EXACT)
    assert float(diameter[25]) == pytest.approx(MIDDLE, rel=EXACT)
    if name != "cylinder":
        assert float(diameter[0]) == pytest.approx(END, rel=EXACT)
    assert bool(jnp.all(jnp.diff(diameter[:26]) >= -EXACT))


@pytest.mark.parametrize("name", SHAPES)
def test_jit_vmap_and_precision(name: str) -> None:
    shape = SHAPES[name]
    eager = shape.diameter(INSIDE, LENGTH)
    jitted = eqx.filter_jit(lambda shape, x: shape.diameter(x, LENGTH))(shape, INSIDE)
    np.testing.assert_allclose(jitted, eager, rtol=EXACT)
    one_by_one = jax.jit(jax.vmap(lambda x: shape.diameter(x, LENGTH)))(INSIDE)
    np.testing.assert_allclose(one_by_one, eager, rtol=EXACT)
    single = jax.tree.map(lambda leaf: leaf.astype(np.float32), shape)
    diameter = single.diameter(np.float32(INSIDE), np.float32(LENGTH))
    assert diameter.dtype == np.float32
    np.testing.assert_allclose(diameter, eager, rtol=3e-6)


@pytest.mark.parametrize("name", SHAPES)
def test_derivatives_are_finite_and_right(name: str) -> None:
    shape = SHAPES[name]
    middle = shape.middle_diameter

    def diameters(middle: jax.Array, length: jax.Array) -> jax.Array:
        return eqx.tree_at(lambda s: s.middle_diameter, shape, middle).diameter(INSIDE, length)

    by_ad = jax.jit(jax.jacfwd(diameters, (0, 1)))(middle, jnp.array(LENGTH))
    h = 1e-6
    numeric = (
        (diameters(middle + h, LENGTH) - diameters(middle - h, LENGTH)) / (2 * h),
        (diameters(middle, LENGTH + h) - diameters(middle, LENGTH - h)) / (2 * h),
    )
    for exact, difference in zip(by_ad, numeric, strict=True):
        np.testing.assert_allclose(exact, difference, atol=1e-7)  # central differences


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


def test_ends_that_do_not_fit_are_an_error() -> None:
    for shape in (ConicFrustumEnds(MIDDLE, END, 3.1), CircularArcEnds(END, MIDDLE)):
        with pytest.raises(RuntimeError, match="at most half the active length"):
            Meridian.of(shape, LENGTH)


def test_arc_angle_in_degrees_is_refused() -> None:
    with pytest.raises(ValueError, match=r"arc_angle lies in \(0, pi / 2\], got 60"):
        EllipticToroidEnds(MIDDLE, END, A, 60.0)
