from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from muscles import TABLE_4_3
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from slow_cases import slow_after

from famjax import Bladder
from famjax.measured import Meridian, maximum_diameter, quadrature
from famjax.profiles import (
    AbstractProfile,
    CircularArcEnds,
    ConicFrustumEnds,
    Cylinder,
    EllipticToroidEnds,
    FourierProfile,
    SemiEllipsoidEnds,
    SteppedCylinder,
)

EXACT = 1e-12
QUADRATURE = 1e-8  # the promise of the default order
L0 = 9.28125
CONTRACTIONS = (0.0, 0.0875, 0.175, 0.2625, 0.35)
Case = tuple[AbstractProfile, float]
# A curve (z, R) of one end from the fitting inwards, its rates, and the range of its parameter.
Curve = Callable[[float], tuple[float, float, float, float]]


def _arc(middle: float, end: float, a: float, angle: float) -> tuple[Curve, float]:
    """Elliptic toroid: by the parameter of its ellipse, 0 where it meets the cylinder."""
    height, axis = (middle - end) / 2 / (1 - np.cos(angle)), a / np.sin(angle)

    def curve(s: float) -> tuple[float, float, float, float]:
        radius = middle / 2 - height * (1 - np.cos(s))
        return a - axis * np.sin(s), radius, axis * np.cos(s), height * np.sin(s)

    return curve, angle


def _ellipsoid(middle: float, end: float, a: float) -> tuple[Curve, float]:
    sine = np.sqrt(1 - (end / middle) ** 2)

    def curve(s: float) -> tuple[float, float, float, float]:
        R = middle / 2
        return a - a / sine * np.sin(s), R * np.cos(s), a / sine * np.cos(s), R * np.sin(s)

    return curve, float(np.arcsin(sine))


def _cone(middle: float, end: float, a: float) -> tuple[Curve, float]:
    slope = (middle - end) / 2 / a
    return lambda s: (a - s, middle / 2 - slope * s, 1.0, slope), a


def _ends_and_cylinder(curve: Curve, reach: float, middle: float, a: float, length: float):
    """Mean diameter, arc, area, volume of two such ends and a cylinder, by scipy along the arc."""

    def integral(element: Callable[[float, float, float], float]) -> float:
        def integrand(s: float) -> float:
            _, radius, along, across = curve(s)
            return element(radius, abs(along), abs(across))

        return quad(integrand, 0, reach, epsabs=1e-13, epsrel=1e-13)[0]

    inner, R = length - 2 * a, middle / 2
    return (
        (2 * integral(lambda r, dz, dr: 2 * r * dz) + middle * inner) / length,
        2 * integral(lambda r, dz, dr: np.hypot(dz, dr)) + inner,
        2 * np.pi * (2 * integral(lambda r, dz, dr: r * np.hypot(dz, dr)) + R * inner),
        np.pi * (2 * integral(lambda r, dz, dr: r**2 * dz) + R**2 * inner),
    )


def _meridian(profile: AbstractProfile, length: jax.Array, order: int | None) -> Meridian:
    if order is None:
        return Meridian.of(profile, length)
    return Meridian.of(profile, length, order=order)


@eqx.filter_jit
def _compiled_measures(
    profile: AbstractProfile, length: jax.Array, order: int | None
) -> tuple[jax.Array, ...]:
    meridian = _meridian(profile, length, order)
    return meridian.mean_diameter, meridian.arc_length, meridian.surface_area, meridian.volume


def _measures(profile: AbstractProfile, length: float, order: int | None = None) -> np.ndarray:
    """By one program for each class of profiles and order."""
    return np.array(_compiled_measures(profile, np.asarray(length), order))


@eqx.filter_jit
def _moments(
    profile: AbstractProfile, length: jax.Array, order: int | None, bladder: Bladder
) -> jax.Array:
    line = _meridian(profile, length, order).inset(0.011)
    strain = line.hoop_strain(bladder)
    return jnp.stack([line.mean(strain**n) for n in range(1, 5)])


ASSUMED = {
    "frustum": (ConicFrustumEnds(2.2, 0.9, 1.1), _cone(2.2, 0.9, 1.1), 1.1),
    "frusta only": (ConicFrustumEnds(2.2, 0.9, 3.0), _cone(2.2, 0.9, 3.0), 3.0),
    "circular": (CircularArcEnds(2.2, 0.9), _arc(2.2, 0.9, 0.65, np.pi / 2), 0.65),
    "ellipsoid": (SemiEllipsoidEnds(2.2, 0.9, 1.1), _ellipsoid(2.2, 0.9, 1.1), 1.1),
    "closed ellipsoid": (SemiEllipsoidEnds(2.2, 0.0, 1.1), _ellipsoid(2.2, 0.0, 1.1), 1.1),
    "slight ellipsoid": (SemiEllipsoidEnds(2.2, 2.1, 0.1), _ellipsoid(2.2, 2.1, 0.1), 0.1),
    "quarter": (EllipticToroidEnds(2.2, 0.9, 1.5), _arc(2.2, 0.9, 1.5, np.pi / 2), 1.5),
    "long quarter": (EllipticToroidEnds(2.2, 0.9, 3.0), _arc(2.2, 0.9, 3.0, np.pi / 2), 3.0),
    "partial": (EllipticToroidEnds(2.2, 0.9, 1.1, 1.0), _arc(2.2, 0.9, 1.1, 1.0), 1.1),
    "nearly quarter": (EllipticToroidEnds(2.2, 0.9, 1.1, 1.5), _arc(2.2, 0.9, 1.1, 1.5), 1.1),
}


@pytest.mark.parametrize("name", ASSUMED)
def test_default_order_against_scipy_on_piecewise_shapes(name: str) -> None:
    shape, (curve, reach), a = ASSUMED[name]
    oracle = _ends_and_cylinder(curve, reach, 2.2, a, 6.0)
    np.testing.assert_allclose(_measures(shape, 6.0), oracle, rtol=QUADRATURE)


@pytest.mark.parametrize("contraction", CONTRACTIONS)
def test_default_order_against_scipy_on_measured_profiles(contraction: float) -> None:
    profile, L = TABLE_4_3[contraction]
    a0, a, b, w = (np.asarray(leaf) for leaf in (profile.a0, profile.a, profile.b, profile.w))
    n = np.arange(1, 4)

    def radius(x: float) -> float:
        return (a0 + np.cos(n * w * x) @ a + np.sin(n * w * x) @ b) / 2

    def stretch(x: float) -> float:
        rate = (n * w) @ (np.cos(n * w * x) * b - np.sin(n * w * x) * a) / 2
        return np.sqrt(1 + (rate / L) ** 2)

    def integral(element: Callable[[float], float]) -> float:
        return quad(element, 0, 1, epsabs=1e-13, epsrel=1e-13)[0]

    oracle = (
        2 * integral(radius),
        L * integral(stretch),
        2 * np.pi * L * integral(lambda x: radius(x) * stretch(x)),
        np.pi * L * integral(lambda x: radius(x) ** 2),
    )
    np.testing.assert_allclose(_measures(profile, L), oracle, rtol=QUADRATURE)


MEASURED = tuple(f"{contraction:.2%}" for contraction in CONTRACTIONS)
SYNTHETIC: dict[str, Case] = {
    **{name: (case[0], 6.0) for name, case in ASSUMED.items()},
    "cylinder": (Cylinder(2.2), 6.0),
    "stepped": (SteppedCylinder(2.2, 0.9, 1.1), 6.0),
    "five terms": (FourierProfile.symmetric(1.6, [-0.4, -0.1, 0.03, 0.02, -0.01], 5.2), 6.0),
}


EVERY = dict(zip(MEASURED, TABLE_4_3.values(), strict=True)) | SYNTHETIC


@pytest.mark.parametrize("name", slow_after(3, [*MEASURED, *SYNTHETIC]))
def test_default_order_against_much_higher_order(name: str) -> None:
    profile, L = EVERY[name]
    np.testing.assert_allclose(
        _measures(profile, L), _measures(profile, L, order=600), rtol=QUADRATURE
    )
    strip = Bladder(L0, 0.875, 0.0625)
    if name != "closed ellipsoid":  # a bladder has no bore in a tip
        default, high = (_moments(profile, np.asarray(L), order, strip) for order in (None, 600))
        np.testing.assert_allclose(default, high, rtol=QUADRATURE)


@pytest.mark.parametrize("name", [*MEASURED, *SYNTHETIC])
def test_a_low_order_is_worse(name: str) -> None:
    """That the comparison above can fail: three stations are not enough for any curved shape."""
    profile, L = EVERY[name]
    error = _measures(profile, L, order=3) / _measures(profile, L) - 1
    flat = name in ("cylinder", "stepped", "frustum", "frusta only")
    assert (np.max(np.abs(error)) < EXACT) == (flat and "frust" not in name)


@pytest.mark.parametrize(
    ("shape", "length", "exact", "tolerance"),
    [
        # Two semi-ellipsoids as long as wide: vertical tangents, and 1 - x loses digits at x = 1.
        (
            SemiEllipsoidEnds(2.0, 0.0, 1.0), 2.0,
            (np.pi / 2, np.pi, 4 * np.pi, 4 / 3 * np.pi), 1e-11,
        ),
        (Cylinder(2.0), 3.0, (2.0, 3.0, 6 * np.pi, 3 * np.pi), EXACT),
        (  # three cylinders
            SteppedCylinder(2.2, 0.9, 1.1), 6.0,
            (
                (0.9 * 2.2 + 2.2 * 3.8) / 6.0,
                6.0,
                np.pi * (0.9 * 2.2 + 2.2 * 3.8),
                np.pi / 4 * (0.9**2 * 2.2 + 2.2**2 * 3.8),
            ),
            EXACT,
        ),
    ],
    ids=["sphere", "cylinder", "stepped"],
)  # fmt: skip
def test_measures_of_simple_bodies(
    shape: AbstractProfile, length: float, exact: tuple[float, ...], tolerance: float
) -> None:
    np.testing.assert_allclose(_measures(shape, length), exact, rtol=tolerance)


def test_slope_is_that_of_the_line() -> None:
    profile, L = TABLE_4_3[0.2625]
    meridian = Meridian.of(profile, L)
    x, _ = quadrature(profile.breakpoints(L))
    h = 1e-5
    rise = (profile.diameter(x + h, L) - profile.diameter(x - h, L)) / 2
    np.testing.assert_allclose(meridian.slope, rise / (2 * h * L), atol=1e-9)  # central difference


def test_quadrature_weights_and_order() -> None:
    x, weights = quadrature(jnp.array([[0.2, 0.7], [0.1, 0.9]]), 7)
    assert x.shape == weights.shape == (2, 21)
    np.testing.assert_allclose(jnp.sum(weights, axis=-1), 1, rtol=EXACT)
    assert bool(jnp.all((x > 0) & (x < 1) & (weights > 0)))


def test_bladder_by_hand() -> None:
    """Thickness, strains and their powers, written out in numpy on a fine even grid."""
    profile, L = TABLE_4_3[0.2625]
    line = Meridian.of(profile, L).inset(0.011)
    bladder = Bladder(L0, 0.875, 0.0625)
    x = (np.arange(20000) + 0.5) / 20000
    radius = np.asarray(profile.diameter(x, L)) / 2 - 0.011
    stretch = np.sqrt(1 + (np.gradient(radius, x) / L) ** 2)
    area = 2 * np.pi * L * np.mean(radius * stretch)
    t = float(bladder.volume) / area
    strain = (radius - t / 2) / (0.4375 - 0.03125) - 1
    coarse = 1e-7  # the midpoint rule's own error, h^2
    assert float(line.thickness(bladder.volume)) == pytest.approx(t, rel=coarse)
    assert float(line.axial_strain(L0)) == pytest.approx(L * np.mean(stretch) / L0 - 1, rel=coarse)
    moments = [np.mean(strain**n) for n in range(1, 5)]
    found = line.hoop_strain(bladder)
    np.testing.assert_allclose([line.mean(found**n) for n in range(1, 5)], moments, rtol=coarse)


def test_embedded_bladder_strains_with_the_line_itself() -> None:
    bladder = Bladder(0.3, 0.02, 0.002, embedded=True)
    line = Meridian.of(Cylinder(0.03), 0.25)
    np.testing.assert_allclose(line.hoop_strain(bladder), 0.5, rtol=EXACT)
    thickness = float(line.thickness(bladder.volume))
    assert thickness == pytest.approx(float(bladder.thickness(0.25, 0.015)), rel=EXACT)


@pytest.mark.parametrize("name", [*MEASURED, "five terms", "cylinder"])
def test_maximum_diameter(name: str) -> None:
    profile, L = EVERY[name]
    diameter = jax.jit(lambda x: profile.diameter(x, L))
    x = np.linspace(0, 1, 2001)
    best = x[int(np.argmax(diameter(x)))]
    bracket = (max(best - 1e-3, 0), min(best + 1e-3, 1))
    oracle = -minimize_scalar(
        lambda x: -float(diameter(x)), bounds=bracket, options={"xatol": 1e-10}
    ).fun
    found = float(maximum_diameter(profile, L))
    assert found == pytest.approx(oracle, rel=1e-12)
    assert found >= float(np.max(diameter(x))) - 1e-13


@pytest.mark.slow
def test_maximum_diameter_at_an_end_and_over_lengths() -> None:
    flared = FourierProfile(1.0, [0.2], [0.0], 3.0)
    assert float(maximum_diameter(flared, 1.0)) == pytest.approx(1.2, rel=EXACT)
    stepped = SteppedCylinder(2.2, 0.9, 1.1)
    np.testing.assert_allclose(maximum_diameter(stepped, jnp.array([3.0, 6.0])), 2.2, rtol=EXACT)


def test_traced_negative_diameter_is_an_error() -> None:
    @eqx.filter_jit
    def volume(a0: jax.Array) -> jax.Array:
        return Meridian.of(FourierProfile(a0, [1.0], [0.0], np.pi), 1.0).volume

    assert float(volume(jnp.array(1.5))) > 0
    with pytest.raises(RuntimeError, match="diameter of a profile must be > 0"):
        volume(jnp.array(0.1)).block_until_ready()
