"""Rounded ends, compliant braids and mountings: what each reduces to, and by what it differs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

import famjax

EXACT = 1e-12
DIFFERENCE = 1e-6  # central differences of a function of order one


def test_end_factor_of_one_is_no_end_effect(festo: famjax.Muscle) -> None:
    ends = famjax.geometries.EndEffectGeometry(festo.geometry, 1.0)
    muscle = famjax.Muscle(ends, festo.material, festo.deadband_pressure)
    L, P = jnp.linspace(0.24, 0.296, 5), 4e5
    np.testing.assert_allclose(muscle.force(L, P), festo.force(L, P), rtol=EXACT)
    assert [float(end) for end in ends.length_range()] == pytest.approx(
        [float(end) for end in festo.geometry.length_range()], rel=EXACT
    )


def test_end_factor_is_a_dead_length(festo: famjax.Muscle) -> None:
    """k = 1/(1 - l/L0): the part that contracts is shorter by l and otherwise the same muscle."""
    k, rest = 1.12, 0.296
    active = rest / k
    braid = famjax.Braid.from_rest(diameter=23e-3, braid_angle=jnp.deg2rad(62.0), length=active)
    short = famjax.Muscle(
        famjax.EstimatedGeometry(braid, famjax.Bladder(active, 23e-3, 1.8e-3, embedded=True)),
        festo.material,
        festo.deadband_pressure,
    )
    muscle = famjax.Muscle(
        famjax.geometries.EndEffectGeometry(festo.geometry, k),
        festo.material,
        festo.deadband_pressure,
    )
    L = jnp.linspace(0.25, 0.296, 7)
    np.testing.assert_allclose(
        muscle.force(L, 5e5), short.force(L - (rest - active), 5e5), rtol=1e-10
    )
    free = muscle.free_contraction(5e5)
    assert float(free) == pytest.approx(float(festo.free_contraction(5e5)) / k, rel=1e-9)


def test_compliant_braid_is_the_elastic_braid_of_linear_threads() -> None:
    thread = famjax.braids.LinearThread(60e9, 2e-8)
    elastic = famjax.ElasticBraid(0.33, 2.2, 0.0, 200.0, thread)
    rigid = famjax.Braid(0.33, 2.2)
    compliant = famjax.braids.CompliantBraid.of(rigid, 1 / (200.0 * 60e9 * 2e-8))
    L, P = jnp.linspace(0.24, 0.3, 5), jnp.linspace(0, 8e5, 5)
    np.testing.assert_allclose(
        compliant.thread_length(L, P), elastic.thread_length(L, P), rtol=1e-12
    )
    none = famjax.braids.CompliantBraid.of(rigid, 0.0)
    np.testing.assert_array_equal(none.thread_length(L, P), np.full(5, 0.33))
    slope = jax.jit(
        jax.grad(lambda c: famjax.braids.CompliantBraid.of(rigid, c).thread_length(0.28, 5e5))
    )
    h = 1e-9
    wider = famjax.braids.CompliantBraid.of(rigid, h).thread_length(0.28, 5e5)
    assert float(slope(0.0)) == pytest.approx(float(wider - 0.33) / h, rel=1e-4)
    assert np.isnan(famjax.braids.CompliantBraid.of(rigid, 1.0).thread_length(0.28, 5e5))


def test_mounted_muscle_balances(festo: famjax.Muscle) -> None:
    c, x, P = 5e-6, jnp.linspace(0.25, 0.296, 6), 5e5
    mounted = famjax.MountedMuscle(festo, c)
    force = mounted.force(x, P)
    np.testing.assert_allclose(force, festo.force(x - c * force, P), rtol=1e-12)
    rigid = famjax.MountedMuscle(festo, 0.0)
    np.testing.assert_allclose(rigid.force(x, P), festo.force(x, P), rtol=1e-12)
    assert (force < rigid.force(x, P)).all()


def test_derivatives_of_a_mounted_muscle(festo: famjax.Muscle) -> None:
    """In length, pressure and compliance, through the implicit solve."""

    def pull(x: jnp.ndarray) -> jnp.ndarray:
        return famjax.MountedMuscle(festo, x[0] * 1e-5).force(0.3 * x[1], 1e6 * x[2]) / 1e3

    check_grads(
        jax.jit(pull), (jnp.array([0.5, 0.9, 0.5]),), order=1, atol=DIFFERENCE, rtol=DIFFERENCE
    )


def test_onset_pressure_is_where_the_force_begins(festo: famjax.Muscle) -> None:
    L = jnp.array([0.25, 0.27, 0.296])
    onset = festo.onset_pressure(L, 2e6)
    np.testing.assert_allclose(festo.force(L, onset), 0.0, atol=1e-8)
    assert float(onset[2]) == pytest.approx(40e3, rel=1e-9)  # at rest: the deadband itself
    slope = jax.jit(jax.grad(lambda L: festo.onset_pressure(L, 2e6)))(0.27)
    h = 1e-6
    difference = festo.onset_pressure(jnp.array([0.27 + h, 0.27 - h]), 2e6)
    assert float(slope) == pytest.approx(float(difference[0] - difference[1]) / (2 * h), rel=1e-6)
    assert np.isnan(festo.onset_pressure(0.25, 1e4, throw=False))
    with pytest.raises(RuntimeError, match="no onset pressure"):
        festo.onset_pressure(0.25, 1e4)


def test_without_deadband_a_muscle_at_rest_pulls_from_zero_pressure_on(
    festo: famjax.Muscle,
) -> None:
    """At rest rounding alone keeps the force from zero; a stretched one pulls without pressure."""
    for end_factor in (1.0, 1.1, 1.3):
        ends = famjax.geometries.EndEffectGeometry(festo.geometry, end_factor)
        muscle = famjax.Muscle(ends, festo.material, 0.0)
        L0 = float(ends.rest_length)
        assert float(muscle.onset_pressure(L0, 2e6)) == pytest.approx(0.0, abs=1e-3)  # Pa
        assert np.isnan(muscle.onset_pressure(1.02 * L0, 2e6, throw=False))


@pytest.mark.slow
def test_monotone_law_is_its_modulus_integrated() -> None:
    knots, moduli = (0.0, 0.05, 0.2), np.array([6e6, 2e6, 4e6])
    law = famjax.materials.MonotoneMaterial(knots, moduli)
    strain = np.linspace(-0.4, 0.4, 41)
    modulus = np.interp(np.abs(strain), knots, moduli)
    np.testing.assert_allclose(law.tangent_modulus(strain), modulus, rtol=1e-12)
    fine = np.linspace(0, 0.4, 400001)
    trapezoid = np.interp(fine, knots, moduli)
    area = np.sum((trapezoid[1:] + trapezoid[:-1]) / 2) * (fine[1] - fine[0])
    assert float(law.stress(0.4)) == pytest.approx(area, rel=1e-9)
    assert float(law.stress(-0.4)) == pytest.approx(-area, rel=1e-9)


@pytest.mark.parametrize(
    ("knots", "moduli", "message"),
    [
        ((0.1, 0.2), [1.0, 2.0], "the first of them 0"),
        ((0.0, 0.2, 0.1), [1.0, 2.0, 3.0], "increasing strains"),
        ((0.0, 0.2), [1.0, 2.0, 3.0], "needs as many moduli"),
    ],
)
def test_monotone_law_refuses(knots: tuple[float, ...], moduli: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        famjax.materials.MonotoneMaterial(knots, moduli)
