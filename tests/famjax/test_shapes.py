"""Profiles, families of them and measured geometry: splines, quadrature, the tables of chapter 6."""

import math
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import muscles as known
import numpy as np
import pytest
from muscles import INELASTIC, KEVLAR, L0, LATEX, SPECIMEN, TABLE_4_3, measured_family
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

import famjax
from famjax import Bladder, EstimatedGeometry, Muscle
from famjax.braids import AbstractBraid, diameter_from_length, gaylord_force
from famjax.geometries import AbstractGeometry
from famjax.measured import AverageDiameterGeometry, MeasuredGeometry, Meridian
from famjax.profiles import FourierProfile, tondu_lopez_length
from famjax.surfaces import AbstractMeasuredFamily, MeasuredFamily, SampledSurface
from famjax.terms import VirtualWork

EXACT = 1e-12
SUMMED = 1e-11  # a derivative of sums over 64 stations
LENGTHS = jnp.linspace(6.0, 9.28, 7)


@pytest.fixture(scope="module")
def measured() -> MeasuredGeometry:
    return MeasuredGeometry(measured_family(KEVLAR), SPECIMEN)


@pytest.mark.slow
def test_muscle_of_the_reference_work(measured):
    """Frozen: blocked force [lbf] and free contraction, confirmed by a second code in numpy."""
    muscle = Muscle(measured, LATEX)
    pressures = jnp.array([20.0, 40.0, 60.0, 80.0, 100.0])
    blocked, free = [171.1, 382.8, 594.1, 804.9, 1015.2], [0.2167, 0.3090, 0.3388, 0.3533, 0.3617]
    np.testing.assert_allclose(muscle.blocked_force(pressures), blocked, atol=0.06)
    np.testing.assert_allclose(muscle.free_contraction(pressures), free, atol=6e-5)


def test_average_geometry_differs_from_measured_in_strain_alone(measured):
    average = AverageDiameterGeometry(measured.family, SPECIMEN)
    L, P = jnp.array([6.2, 7.5, 9.2]), jnp.array([20.0, 60.0, 100.0])
    one, other = measured.dimensions(L, P), average.dimensions(L, P)
    for name in ("length", "radius", "braid_angle", "turns", "bladder_volume"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=EXACT)
    assert (one.axial_strain > other.axial_strain).all()  # the arc is longer than the chord
    assert (one.volume > other.volume).all()  # the mean of D^2 exceeds the square of the mean


def _work(geometry: AbstractGeometry, deadband: float = 0.0, *, held: bool = False) -> Muscle:
    """The muscle that pulls by the virtual work of its volume alone."""
    return Muscle(geometry, VirtualWork(deadband, at_thread_length=held))


def test_a_cylinder_gives_gaylord_once_the_threads_work_is_taken_out():
    for braid, tolerance in ((INELASTIC, SUMMED), (KEVLAR, SUMMED)):
        geometry = EstimatedGeometry(braid, SPECIMEN)
        at = geometry.dimensions(LENGTHS, 100.0)
        gaylord = gaylord_force(97.0, at.radius, at.braid_angle)
        held = _work(geometry, 3.0, held=True).force(LENGTHS, 100.0)
        np.testing.assert_allclose(held, gaylord, rtol=tolerance)
    # Without: the work that goes into the threads is missing from the pull.
    assert bool(jnp.all(_work(geometry, 3.0).force(LENGTHS, 100.0) < gaylord - 2))


@pytest.mark.slow
def test_the_work_is_the_pressure_times_the_volume_swept(measured):
    nodes, weights = np.polynomial.legendre.leggauss(12)
    ends, muscle = np.asarray(measured.family.lengths), _work(measured)
    short, long = ends[1:, None], ends[:-1, None]
    length = (short + long) / 2 + (long - short) / 2 * nodes
    work = np.sum((long - short) / 2 * weights * muscle.force(length, 100.0))
    volume = measured.dimensions(ends[[0, -1]], 100.0).volume
    assert work == pytest.approx(100.0 * float(volume[1] - volume[0]), rel=1e-10)


def symmetric(a0: float, a: list[float], w: float) -> FourierProfile:
    """The profile symmetric about x = 1/2 with these cosine terms."""
    return FourierProfile(a0, a, a * np.tan(np.arange(1, len(a) + 1) * w / 2), w)


SERIES: dict[str, tuple[FourierProfile, float]] = {
    **{f"{contraction:.2%}": case for contraction, case in TABLE_4_3.items()},
    "five terms": (symmetric(1.6, [-0.4, -0.1, 0.03, 0.02, -0.01], 5.2), 6.0),
}


@pytest.mark.parametrize("name", SERIES)
def test_default_order_against_scipy_on_series(name):
    profile, L = SERIES[name]
    a0, a, b, w = (np.asarray(leaf) for leaf in (profile.a0, profile.a, profile.b, profile.w))
    n = np.arange(1, a.size + 1)

    def radius(x: float) -> float:
        return (a0 + np.cos(n * w * x) @ a + np.sin(n * w * x) @ b) / 2

    def stretch(x: float) -> float:
        rate = (n * w) @ (np.cos(n * w * x) * b - np.sin(n * w * x) * a) / 2
        return np.sqrt(1 + (rate / L) ** 2)

    def integral(element: Callable[[float], float]) -> float:
        return quad(element, 0, 1, epsabs=1e-13, epsrel=1e-13)[0]

    side, disk = integral(lambda x: radius(x) * stretch(x)), integral(lambda x: radius(x) ** 2)
    oracle = 2 * integral(radius), L * integral(stretch), 2 * np.pi * L * side, np.pi * L * disk
    line = Meridian.of(profile.diameter, L)
    found = line.mean_diameter, line.arc_length, line.surface_area, line.volume
    np.testing.assert_allclose(found, oracle, rtol=1e-8)  # the promise of the default order


def test_bladder_by_hand():
    """Thickness, strains and their powers, written out in numpy on a fine even grid."""
    profile, L = TABLE_4_3[0.2625]
    line = Meridian.of(profile.diameter, L).inset(0.011)
    bladder = Bladder(L0, 0.875, 0.0625)
    x = (np.arange(20000) + 0.5) / 20000
    radius = np.asarray(profile.diameter(x, L)) / 2 - 0.011
    stretch = np.sqrt(1 + (np.gradient(radius, x) / L) ** 2)
    t = float(bladder.volume) / (2 * np.pi * L * np.mean(radius * stretch))
    strain = (radius - t / 2) / (0.4375 - 0.03125) - 1
    coarse = 1e-7  # the midpoint rule's own error, h^2
    assert float(line.thickness(bladder.volume)) == pytest.approx(t, rel=coarse)
    assert float(line.axial_strain(L0)) == pytest.approx(L * np.mean(stretch) / L0 - 1, rel=coarse)
    moments = [np.mean(strain**n) for n in range(1, 5)]
    found = line.hoop_strain(bladder)
    np.testing.assert_allclose([line.mean(found**n) for n in range(1, 5)], moments, rtol=coarse)


def test_tondu_lopez():
    length = jnp.array([0.30, 0.27, 0.24])
    np.testing.assert_allclose(tondu_lopez_length(length, 0.3, 1.0), length, rtol=EXACT)
    # Their force, pi r0^2 P (a (1 - k eps)^2 - b), is Gaylord's at this length.
    r0, angle, k, P = 0.01, 1.2, 1.25, 3e5
    a, b = 3 * math.tan(angle) ** 2, 1 / math.cos(angle) ** 2
    published = math.pi * r0**2 * P * (a * (1 - k * (1 - length / 0.3)) ** 2 - b)
    thread, turns = 0.3 / math.sin(angle), 0.3 / (2 * math.pi * r0 * math.tan(angle))
    L = tondu_lopez_length(length, 0.3, k)
    gaylord = P * (3 * L**2 - thread**2) / (4 * math.pi * turns**2)
    np.testing.assert_allclose(gaylord, published, rtol=EXACT)


ROUNDING = 1e-11  # a small linear system has been solved
X = np.linspace(0, 1, 17)


def _profile(contraction: float) -> FourierProfile:
    """A made-up muscle: a wave number that varies with contraction, as measured ones do."""
    bulge = 0.2 + 2.0 * contraction
    return symmetric(1.0 + bulge / 2, [-bulge / 3, -0.02], 5.6 - 1.5 * contraction)


def _spline_family(contractions: np.ndarray, braid: AbstractBraid = INELASTIC, **kwargs: float):
    profiles = [_profile(contraction) for contraction in contractions]
    return MeasuredFamily(9.28 * (1 - contractions), profiles, 100.0, braid, **kwargs)


EVEN = np.array([0.0, 0.09, 0.18, 0.27, 0.35])


@eqx.filter_jit
def _diameter(family: AbstractMeasuredFamily, x: object, length: object, pressure: object):
    """Compiled once for each kind of family and shape of the arguments."""
    return family.diameter(x, length, pressure)


@pytest.mark.parametrize(
    "contractions", [EVEN, np.array([0, 0.02, 0.15, 0.2, 0.33]), EVEN[:4], EVEN[:3], EVEN[:2]]
)
def test_is_scipys_not_a_knot_spline_also_in_the_margin(contractions):
    family = _spline_family(contractions)
    table = np.stack([profile.diameter(X, 1.0) for profile in family.profiles])
    oracle = CubicSpline(contractions, table)
    lengths = np.linspace(*(float(end) for end in family.length_range()), 50)
    np.testing.assert_allclose(
        _diameter(family, X, lengths[:, None], 100.0), oracle(1 - lengths / 9.28), rtol=ROUNDING
    )


def test_pressure_scales_by_the_triangle():
    family = _spline_family(EVEN, known.KEVLAR)
    L, P = jnp.array([6.5, 9.0])[:, None], 30.0
    threads = [known.KEVLAR.thread_length(L, jnp.array(pressure)) for pressure in (P, 100.0)]
    scale = [diameter_from_length(L, one, 1.09) for one in threads]
    low, high = (np.asarray(_diameter(family, X, L, np.array(at))) for at in (P, 100.0))
    np.testing.assert_allclose(low, high * np.asarray(scale[0]) / np.asarray(scale[1]), rtol=EXACT)
    assert (low < high).all()
    rigid = np.asarray(_diameter(_spline_family(EVEN), X, L, np.array(100.0)))
    np.testing.assert_allclose(high, rigid, rtol=ROUNDING)  # as measured, whatever the braid


STATIONS = np.linspace(0, 1, 21)
MEASURED_LENGTHS = np.array([0.30, 0.27, 0.25, 0.21])


def diameters() -> np.ndarray:
    wide = 0.02 + 0.02 * (0.30 - MEASURED_LENGTHS[:, None]) / 0.09 * np.sin(np.pi * STATIONS) ** 0.5
    return np.stack([wide, wide * (1 + 0.02 * STATIONS)])


def test_between_them_it_is_the_spline_of_scipy():
    braid = famjax.Braid(0.32, 1.5, 3e-4)
    surface = SampledSurface(MEASURED_LENGTHS, np.array([1e5, 5e5]), diameters(), braid)
    x, length, pressure = np.linspace(0, 1, 57), 0.233, 3.7e5
    along = CubicSpline(STATIONS, diameters(), axis=2)(x)
    over = CubicSpline(MEASURED_LENGTHS[::-1], along[:, ::-1], axis=1)(length)
    expected = over[0] + (pressure - 1e5) / 4e5 * (over[1] - over[0])
    np.testing.assert_allclose(surface.diameter(x, length, pressure), expected, rtol=1e-12)
