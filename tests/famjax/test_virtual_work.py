from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax import Bladder, Braid, EstimatedGeometry, Muscle, PolynomialMaterial
from famjax.braids import ElasticBraid, LinearThread, gaylord_force
from famjax.measured import AverageDiameterGeometry, MeasuredGeometry
from famjax.profiles import CircularArcEnds, Cylinder
from famjax.surfaces import AssumedShapeFamily, MeasuredFamily
from famjax.terms import BladderWall, VirtualWork, pressure_terms, virtual_work_force, volume_rate

EXACT = 1e-11  # a derivative of sums over 64 stations
L0 = 9.28125
SPECIMEN = Bladder(L0, 0.875, 0.0625)
INELASTIC = Braid(9.89, 1.09, 0.011)
ELASTIC = ElasticBraid(9.89, 1.09, 0.011, 144, LinearThread(11.6e6, 1.332e-4))
LENGTHS = jnp.linspace(6.0, 9.28, 7)


@pytest.fixture(scope="module")
def measured(measured_family: Callable[[ElasticBraid], MeasuredFamily]) -> MeasuredGeometry:
    return MeasuredGeometry(measured_family(ELASTIC), SPECIMEN)


def _gaylord(geometry: EstimatedGeometry, pressure: float) -> jax.Array:
    at = geometry.dimensions(LENGTHS, pressure)
    return gaylord_force(pressure, at.radius, at.braid_angle)


def test_an_inelastic_cylinder_gives_gaylord() -> None:
    geometry = EstimatedGeometry(INELASTIC, SPECIMEN)
    np.testing.assert_allclose(
        virtual_work_force(geometry, LENGTHS, 80.0), _gaylord(geometry, 80.0), rtol=EXACT
    )
    family = AssumedShapeFamily(INELASTIC, Cylinder(1.0))
    np.testing.assert_allclose(
        virtual_work_force(family, LENGTHS, 80.0), _gaylord(geometry, 80.0), rtol=EXACT
    )


def test_an_elastic_cylinder_gives_gaylord_once_the_threads_work_is_taken_out() -> None:
    geometry = EstimatedGeometry(ELASTIC, SPECIMEN)
    gaylord = _gaylord(geometry, 100.0)
    held = virtual_work_force(geometry, LENGTHS, 100.0, braid=ELASTIC)
    np.testing.assert_allclose(held, gaylord, rtol=1e-9)  # the braid's root is solved to 1e-12
    # Without: the work that goes into the threads is missing from the pull.
    assert bool(jnp.all(virtual_work_force(geometry, LENGTHS, 100.0) < gaylord - 2))


def test_rounded_ends_by_differences() -> None:
    shape = CircularArcEnds(9.9, 0.863)
    family = AssumedShapeFamily(INELASTIC, shape)

    def volume(L: np.ndarray) -> np.ndarray:
        """By hand: a cylinder, and twice a quarter toroid by Pappus plus the core inside it."""
        R = np.sqrt(9.89**2 - L**2) / (2 * np.pi * 1.09)
        r, core = R - 0.863 / 2, 0.863 / 2
        end = np.pi * (core**2 * r + 2 * core * np.pi / 4 * r**2 + 2 / 3 * r**3)
        return np.pi * R**2 * (L - 2 * r) + 2 * end

    L, h = np.linspace(6.0, 9.2, 5), 1e-5
    numeric = -50.0 * (volume(L + h) - volume(L - h)) / (2 * h)
    np.testing.assert_allclose(virtual_work_force(family, L, 50.0), numeric, rtol=1e-8)


@pytest.mark.slow
def test_the_work_is_the_pressure_times_the_volume_swept(measured: MeasuredGeometry) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(12)
    ends = np.asarray(measured.family.lengths)
    work = 0.0
    for short, long in zip(ends[1:], ends[:-1], strict=True):
        length = (short + long) / 2 + (long - short) / 2 * nodes
        force = virtual_work_force(measured, length, 100.0)
        work += (long - short) / 2 * float(np.sum(weights * force))
    volume = measured.dimensions(ends[[0, -1]], 100.0).volume
    assert work == pytest.approx(100.0 * float(volume[1] - volume[0]), rel=1e-10)


@pytest.mark.slow
def test_fluid_and_outline_have_one_rate(measured: MeasuredGeometry) -> None:
    """The family's outline and the geometry's dimensions are two ways to the same volume."""
    np.testing.assert_allclose(
        volume_rate(measured.family, LENGTHS, 60.0), volume_rate(measured, LENGTHS, 60.0), rtol=1e-9
    )


@pytest.mark.slow
def test_pressure_term_of_a_muscle(measured: MeasuredGeometry) -> None:
    law = PolynomialMaterial([257.8, -57.9, 32.7])
    for braid in (None, ELASTIC):
        term = VirtualWork(3.0, at_thread_length=braid is not None)
        muscle = Muscle(measured, term + BladderWall(law))
        inner = Muscle(measured, law, 3.0)
        expected = -(60.0 - 3.0) * volume_rate(measured, LENGTHS, 60.0, braid=braid)
        np.testing.assert_allclose(muscle.braid_force(LENGTHS, 60.0), expected, rtol=EXACT)
        np.testing.assert_allclose(
            muscle.bladder_force(LENGTHS, 60.0), inner.bladder_force(LENGTHS, 60.0), rtol=EXACT
        )
        np.testing.assert_allclose(
            muscle.force(LENGTHS, 60.0), expected + inner.bladder_force(LENGTHS, 60.0), rtol=EXACT
        )


def test_nothing_is_lost_at_no_pressure() -> None:
    plain = Muscle(EstimatedGeometry(INELASTIC, SPECIMEN), PolynomialMaterial([257.8]))
    muscle = Muscle(plain.geometry, VirtualWork() + BladderWall(plain.material))
    rates = jax.jit(jax.grad(muscle.force, argnums=(0, 1)))(9.0, 0.0)
    expected = jax.jit(jax.grad(plain.force, argnums=(0, 1)))(9.0, 0.0)
    np.testing.assert_allclose(rates, expected, rtol=EXACT)


@pytest.mark.slow
def test_jit_vmap_and_derivative(measured: MeasuredGeometry) -> None:
    eager = virtual_work_force(measured, LENGTHS, 60.0)
    assert virtual_work_force(measured, LENGTHS[:, None], jnp.ones(2)).shape == (7, 2)
    jitted = eqx.filter_jit(lambda source, L: virtual_work_force(source, L, 60.0))
    np.testing.assert_allclose(jitted(measured, LENGTHS), eager, rtol=EXACT)
    batched = jax.jit(jax.vmap(lambda L: virtual_work_force(measured, L, 60.0)))(LENGTHS)
    np.testing.assert_allclose(batched, eager, rtol=EXACT)
    slope = jax.jit(jax.grad(lambda L: virtual_work_force(measured, L, 60.0)))(7.5)
    h = 1e-4
    ahead, behind, *_ = virtual_work_force(measured, 7.5 + h * np.array([1, -1, *[0] * 5]), 60.0)
    assert float(slope) == pytest.approx(float(ahead - behind) / (2 * h), rel=1e-6)


def test_float32() -> None:
    single = jax.tree.map(
        lambda leaf: jnp.asarray(leaf, np.float32), EstimatedGeometry(INELASTIC, SPECIMEN)
    )
    force = virtual_work_force(single, np.float32(8), np.float32(80))
    assert force.dtype == np.float32
    exact = virtual_work_force(EstimatedGeometry(INELASTIC, SPECIMEN), 8.0, 80.0)
    assert float(force) == pytest.approx(float(exact), rel=1e-5)


@pytest.mark.slow
def test_report_on_the_reference_specimen(measured: MeasuredGeometry) -> None:
    """What virtual work changes, in lbf at 100 psi; rounding of table 4.3 leaves 24, 8 and 35."""
    contraction = jnp.array([0.0, 0.175, 0.35])
    compiled = eqx.filter_jit(pressure_terms)
    terms = compiled(measured, contraction, 100.0, braid=ELASTIC)
    np.testing.assert_allclose(terms.gaylord, [1068.3, 536.4, 107.0], atol=0.06)
    np.testing.assert_allclose(terms.virtual_work, [897.7, 434.4, 127.1], atol=0.06)
    np.testing.assert_allclose(
        terms.virtual_work_at_thread_length, [905.1, 440.2, 131.5], atol=0.06
    )
    cylinder = AverageDiameterGeometry(measured.family, SPECIMEN)
    by_cylinder = compiled(cylinder, contraction, 100.0)
    np.testing.assert_allclose(by_cylinder.gaylord, terms.gaylord, rtol=EXACT)
    np.testing.assert_array_equal(
        by_cylinder.virtual_work, by_cylinder.virtual_work_at_thread_length
    )
